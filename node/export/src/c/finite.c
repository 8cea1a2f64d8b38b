/* The number, or NaN if it is not finite.
   @needs bits
   @source */
static double mrd_finite(double x) {
    return mrd_is_finite(x) ? x : mrd_nan();
}
