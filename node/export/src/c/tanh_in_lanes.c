/* tanh z = +-(e^(2|z|) - 1)/(e^(2|z|) + 1) as networks take it: e^y = 2^n e^r, n = round(y / ln 2), |r| <= ln 2 / 2: Taylor to r^12. Absolute error 4e-16.
   @needs bits clamp
   @source */
static double mrd_tanh_in_lanes(double z) {
    static const double taylor[13] = {
        1.0 / 479001600.0, 1.0 / 39916800.0, 1.0 / 3628800.0, 1.0 / 362880.0, 1.0 / 40320.0, 1.0 / 5040.0, 1.0 / 720.0,
        1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0
    };
    const double y = 2.0 * mrd_clamp(mrd_abs(z), 0.0, 20.0);
    const double shifted = y * 1.4426950408889634 + 6755399441055744.0;
    const double n = shifted - 6755399441055744.0;
    const double r = (y - n * 6.931471803691238e-1) - n * 1.9082149292705877e-10;
    double series = 0.0, e;
    int k;
    for (k = 0; k < 13; k++) {
        series = series * r + taylor[k];
    }
    e = mrd_from_bits(mrd_to_bits(series) + (mrd_to_bits(shifted) << 52));
    e = (e - 1.0) / (e + 1.0);
    return mrd_from_bits(mrd_to_bits(e) | (mrd_to_bits(z) & UINT64_C(0x8000000000000000)));
}
