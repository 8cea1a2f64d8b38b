/* tanh x = +-(e^(2|x|) - 1)/(e^(2|x|) + 1). Absolute error 4e-16.
   @needs exp
   @source */
static double mrd_tanh(double x) {
    const double size = mrd_abs(x);
    double value = 1.0;
    if (!(size > 20.0)) {
        const double e = mrd_exp(2.0 * size);
        value = (e - 1.0) / (e + 1.0);
    }
    return mrd_from_bits(mrd_to_bits(value) | (mrd_to_bits(x) & UINT64_C(0x8000000000000000)));
}
