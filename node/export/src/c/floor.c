/* The largest integer that is not above x.
   @needs bits
   @source */
static double mrd_floor(double x) {
    double whole;
    if (!(mrd_abs(x) < 4503599627370496.0)) {
        return x; /* an integer, infinite, or NaN */
    }
    whole = (double)(int64_t)x;
    return whole > x ? whole - 1.0 : whole;
}
