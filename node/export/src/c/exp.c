/* e^x = 2^e T_j e^r,   x = (16 e + j) ln 2 / 16 + r,   |r| <= ln 2 / 32,   T_j = 2^(j/16): Taylor to r^7. Error 0.6 ulp.
   After P. T. P. Tang, ACM Trans. Math. Softw. 15 (1989) 144.
   @needs bits infinity
   @source */
/* 2^(j/16): a number, and its rounding error. */
static const double mrd_powers[16][2] = {
    { 1.0, 0.0 },
    { 1.0442737824274138, 8.551889705537965e-17 },
    { 1.0905077326652577, -3.046782079812471e-17 },
    { 1.1387886347566916, 8.912812676025408e-17 },
    { 1.189207115002721, 3.982015231465646e-17 },
    { 1.241857812073484, 4.658027591836937e-17 },
    { 1.2968395546510096, 2.5382502794888315e-17 },
    { 1.3542555469368927, 7.70094837980299e-17 },
    { 1.4142135623730951, -9.667293313452913e-17 },
    { 1.4768261459394993, -3.483994556892796e-17 },
    { 1.5422108254079407, 7.949834809697621e-17 },
    { 1.6104903319492543, 2.4707192569797888e-17 },
    { 1.681792830507429, 8.199010020581497e-17 },
    { 1.7562521603732995, 2.960140695448873e-17 },
    { 1.8340080864093424, 3.283107224245627e-17 },
    { 1.9152065613971474, -1.0619946056195963e-16 }
};

/* Adding this constant to a number below 2^51 rounds it to an integer, which is then in the lowest bits. */
#define MRD_ROUND 6755399441055744.0

typedef struct {
    int32_t e;
    double high, low, p;
} mrd_split_exponent;

static mrd_split_exponent mrd_split(double x) {
    mrd_split_exponent found;
    const double shifted = x * 23.083120654223414 + MRD_ROUND;
    const int32_t index = (int32_t)(uint32_t)(mrd_to_bits(shifted) & UINT64_C(0xffffffff));
    const double n = shifted - MRD_ROUND;
    const double r = (x - n * 0.04332169878489367) - n * 1.0291218489310676e-13;
    const double square = r * r;
    const double far = (1.0 / 24.0 + r * (1.0 / 120.0)) + square * (1.0 / 720.0 + r * (1.0 / 5040.0));
    const double tail = (0.5 + r * (1.0 / 6.0)) + square * far;
    const int32_t j = index & 15;
    found.e = (index - j) / 16;
    found.high = mrd_powers[j][0];
    found.low = mrd_powers[j][1];
    found.p = r + square * tail;
    return found;
}

/* 2^e for e from -1022 to 1023. */
static inline double mrd_power_of_two(int32_t e) {
    return mrd_from_bits((uint64_t)(uint32_t)(e + 1023) << 52);
}

static double mrd_exp(double x) {
    mrd_split_exponent s;
    int32_t half;
    if (mrd_abs(x) <= 700.0) {
        s = mrd_split(x);
        return (s.high + (s.low + s.high * s.p)) * mrd_power_of_two(s.e);
    }
    if (mrd_is_nan(x)) {
        return x;
    }
    if (x > 710.0) {
        return mrd_infinity();
    }
    if (x < -746.0) {
        return 0.0;
    }
    s = mrd_split(x);
    half = s.e / 2;
    return (s.high + (s.low + s.high * s.p)) * mrd_power_of_two(half) * mrd_power_of_two(s.e - half);
}
