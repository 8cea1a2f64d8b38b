/* ln x = e ln 2 + 2 artanh s,   x = 2^e z,   s = (z - 1)/(z + 1),   z from sqrt(1/2) to sqrt(2): series to s^11. Error 2 ulp.
   @needs exp infinity
   @source */
static float mrd_ln_scaled(float x, int32_t more) {
    const uint32_t beyond = mrd_to_bits(x) - UINT32_C(0x3f3504f3);
    const int32_t top = (int32_t)(beyond >> 23);
    const int32_t e = top >= 256 ? top - 512 : top;
    const float z = mrd_from_bits((beyond & UINT32_C(0x007fffff)) + UINT32_C(0x3f3504f3));
    const float octaves = (float)(e + more);
    const float s = (z - 1.0f) / (z + 1.0f);
    const float square = s * s;
    const float tail = 1.0f / 3.0f
        + square * (1.0f / 5.0f + square * (1.0f / 7.0f + square * (1.0f / 9.0f + square * (1.0f / 11.0f))));
    return octaves * 0.693359375f + (2.0f * s + (2.0f * (s * square * tail) - octaves * 2.1219444005469057e-4f));
}

static float mrd_ln(float x) {
    if (x >= 1.17549435e-38f && x < mrd_infinity()) {
        return mrd_ln_scaled(x, 0);
    }
    if (x <= 0.0f && x >= 0.0f) {
        return -mrd_infinity();
    }
    if (x > 0.0f && x < mrd_infinity()) {
        return mrd_ln_scaled(x * mrd_power_of_two(25), -25);
    }
    return x > 0.0f ? x : mrd_nan();
}
