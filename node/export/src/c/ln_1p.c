/* ln(1 + x) for x from 0 to 1. Error 2.4 ulp.
   @needs ln
   @source */
static double mrd_ln_1p(double x) {
    const double sum = 1.0 + x;
    return mrd_ln(sum) + (x - (sum - 1.0)) / sum;
}
