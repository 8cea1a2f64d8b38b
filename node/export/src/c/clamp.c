/* The value, or the bound that it lies beyond. NaN stays NaN.
   @needs bits
   @source */
static double mrd_clamp(double x, double low, double high) {
    if (x < low) {
        return low;
    }
    return x > high ? high : x;
}
