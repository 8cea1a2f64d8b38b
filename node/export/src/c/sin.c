/* sin x: x = n pi/2 + r, and the Taylor series of sin r or cos r. NaN beyond 1e6 rad. Error 2.0 ulp.
   @needs bits
   @source */
static double mrd_sine_near(double r) {
    static const double taylor[8] = {
        1.0 / 355687428096000.0, -1.0 / 1307674368000.0, 1.0 / 6227020800.0, -1.0 / 39916800.0, 1.0 / 362880.0,
        -1.0 / 5040.0, 1.0 / 120.0, -1.0 / 6.0
    };
    const double square = r * r;
    double series = 0.0;
    int k;
    for (k = 0; k < 8; k++) {
        series = series * square + taylor[k];
    }
    return r + r * square * series;
}

static double mrd_cosine_near(double r) {
    static const double taylor[8] = {
        -1.0 / 6402373705728000.0, 1.0 / 20922789888000.0, -1.0 / 87178291200.0, 1.0 / 479001600.0, -1.0 / 3628800.0,
        1.0 / 40320.0, -1.0 / 720.0, 1.0 / 24.0
    };
    const double square = r * r;
    const double half = 0.5 * square;
    const double one = 1.0 - half;
    double series = 0.0;
    int k;
    for (k = 0; k < 8; k++) {
        series = series * square + taylor[k];
    }
    return one + (((1.0 - one) - half) + square * square * series);
}

static double mrd_sin(double x) {
    double shifted, n, r, value;
    uint32_t quarter;
    if (mrd_is_nan(x) || mrd_abs(x) > 1e6) {
        return mrd_nan();
    }
    shifted = x * 0.6366197723675814 + 6755399441055744.0;
    n = shifted - 6755399441055744.0;
    r = ((x - n * 1.5707963267341256) - n * 6.077100506303966e-11) - n * 2.0222662487959506e-21;
    quarter = (uint32_t)(mrd_to_bits(shifted) & 3U);
    value = (quarter & 1U) == 0U ? mrd_sine_near(r) : mrd_cosine_near(r);
    return (quarter & 2U) == 0U ? value : -value;
}
