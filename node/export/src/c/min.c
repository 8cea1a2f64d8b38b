/* The smaller of two values; the other one if one of them is NaN.
   @needs bits
   @source */
static double mrd_min(double a, double b) {
    return (a <= b || mrd_is_nan(b)) ? a : b;
}
