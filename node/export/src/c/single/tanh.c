/* tanh x = +-m/(m + 2),   m = e^(2|x|) - 1. Error 3 ulp.
   @needs exp_m1 has_minus
   @source */
static float mrd_tanh(float x) {
    const float size = mrd_abs(x);
    float value = 1.0f;
    if (!(size > 10.0f)) {
        const float m = mrd_exp_m1(2.0f * size);
        value = m / (m + 2.0f);
    }
    return mrd_has_minus(x) ? -value : value;
}
