/* sin x: x = n pi/2 + r, and the Taylor series of sin r or cos r. NaN beyond 1e6 rad. Error 2 ulp, and above 1e4 rad that of x.
   @needs bits
   @source */
static float mrd_sine_near(float r) {
    const float square = r * r;
    const float series = -1.0f / 6.0f + square * (1.0f / 120.0f + square * (-1.0f / 5040.0f + square * (1.0f / 362880.0f)));
    return r + r * square * series;
}

static float mrd_cosine_near(float r) {
    const float square = r * r;
    const float half = 0.5f * square;
    const float one = 1.0f - half;
    const float series = 1.0f / 24.0f + square * (-1.0f / 720.0f + square * (1.0f / 40320.0f - square * (1.0f / 3628800.0f)));
    return one + (((1.0f - one) - half) + square * square * series);
}

static float mrd_sin(float x) {
    float shifted, n, r, value;
    uint32_t quarter;
    if (mrd_is_nan(x) || mrd_abs(x) > 1e6f) {
        return mrd_nan();
    }
    shifted = x * 0.6366197723675814f + 12582912.0f;
    n = shifted - 12582912.0f;
    r = ((x - n * 1.5703125f) - n * 4.8375129699707031e-4f) - n * 7.5497899548918822e-8f;
    quarter = mrd_to_bits(shifted) & 3U;
    value = (quarter & 1U) == 0U ? mrd_sine_near(r) : mrd_cosine_near(r);
    return (quarter & 2U) == 0U ? value : -value;
}
