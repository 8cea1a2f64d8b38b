/* e^x - 1, exact for small x. Error 2 ulp.
   @needs exp
   @source */
static float mrd_exp_m1(float x) {
    if (mrd_abs(x) <= 17.5f) {
        const mrd_split_exponent s = mrd_split(x);
        const float scale = mrd_power_of_two(s.n);
        return (scale - 1.0f) + scale * s.p;
    }
    return mrd_exp(x) - 1.0f;
}
