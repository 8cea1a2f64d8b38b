/* 1 or -1 with the sign of x, also of zero; NaN for NaN.
   @needs bits has_minus
   @source */
static double mrd_signum(double x) {
    if (mrd_is_nan(x)) {
        return x;
    }
    return mrd_has_minus(x) ? -1.0 : 1.0;
}
