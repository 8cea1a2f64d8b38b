/* e^x = 2^n e^r,   n = round(x / ln 2),   |r| <= ln 2 / 2: Taylor to r^8. Error 1.0 ulp.
   @needs bits infinity
   @source */
/* Adding this constant to a number below 2^22 rounds it to an integer, which is then in the lowest bits. */
#define MRD_ROUND 12582912.0f

typedef struct {
    int32_t n;
    float p; /* e^r - 1 */
} mrd_split_exponent;

static mrd_split_exponent mrd_split(float x) {
    mrd_split_exponent found;
    const float shifted = x * 1.4426950408889634f + MRD_ROUND;
    const float n = shifted - MRD_ROUND;
    const float r = (x - n * 0.693359375f) + n * 2.1219444005469057e-4f;
    const float square = r * r;
    const float far = (1.0f / 24.0f + r * (1.0f / 120.0f)) + square * ((1.0f / 720.0f + r * (1.0f / 5040.0f)) + square * (1.0f / 40320.0f));
    const float tail = (0.5f + r * (1.0f / 6.0f)) + square * far;
    found.n = (int32_t)n;
    found.p = r + square * tail;
    return found;
}

/* 2^n for n from -126 to 127. */
static inline float mrd_power_of_two(int32_t n) {
    return mrd_from_bits((uint32_t)(n + 127) << 23);
}

static float mrd_exp(float x) {
    mrd_split_exponent s;
    int32_t half;
    if (mrd_is_nan(x)) {
        return x;
    }
    if (x > 89.0f) {
        return mrd_infinity();
    }
    if (x < -104.0f) {
        return 0.0f;
    }
    s = mrd_split(x);
    half = s.n / 2;
    return (1.0f + s.p) * mrd_power_of_two(half) * mrd_power_of_two(s.n - half);
}
