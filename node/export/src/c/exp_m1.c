/* e^x - 1, exact for small x. Error 2.2 ulp.
   @needs exp
   @source */
static double mrd_exp_m1(double x) {
    if (mrd_abs(x) <= 40.0) {
        const mrd_split_exponent s = mrd_split(x);
        const double scale = mrd_power_of_two(s.e);
        return (scale * s.high - 1.0) + scale * (s.low + s.high * s.p);
    }
    return mrd_exp(x) - 1.0;
}
