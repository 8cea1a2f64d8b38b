/* 1 or -1 with the sign of x, also of zero; NaN for NaN.
   @needs bits
   @source */
static double mrd_signum(double x) {
    if (mrd_is_nan(x)) {
        return x;
    }
    return (mrd_to_bits(x) >> 63) != 0U ? -1.0 : 1.0;
}
