/* atan x = atan(k/8) + atan t,   t = (x - k/8)/(1 + x k/8),   |t| <= 1/16;   pi/2 - atan(1/x) above 1. Error 2 ulp.
   @needs bits
   @source */
/* atan(k/8): a number, and its rounding error. */
static const float mrd_arcs[9][2] = {
    { 0.0f, 0.0f },
    { 0.124354996f, -1.24038224e-09f },
    { 0.244978666f, -3.17867777e-09f },
    { 0.358770669f, 1.76394988e-09f },
    { 0.463647604f, 5.01215869e-09f },
    { 0.558599293f, 2.21115979e-08f },
    { 0.643501103f, 5.86893734e-09f },
    { 0.718829989f, 1.01883355e-08f },
    { 0.785398185f, -2.18556941e-08f }
};

static int mrd_nearest_eighth(float y) {
    return (int)(mrd_to_bits(y * 8.0f + 12582912.0f) & 15U);
}

static float mrd_odd_terms(float t) {
    const float square = t * t;
    return t * square * (-1.0f / 3.0f + square * (1.0f / 5.0f + square * (-1.0f / 7.0f)));
}

static float mrd_atan(float x) {
    const float size = mrd_abs(x);
    float value = 1.57079637f;
    if (mrd_is_nan(x)) {
        return x;
    }
    if (size <= 1.0f) {
        const int k = mrd_nearest_eighth(size);
        const float c = (float)k * 0.125f;
        const float t = (size - c) / (1.0f + size * c);
        value = mrd_arcs[k][0] + (t + (mrd_odd_terms(t) + mrd_arcs[k][1]));
    } else if (size < 1e9f) {
        const int k = mrd_nearest_eighth(1.0f / size);
        const float c = (float)k * 0.125f;
        const float t = (1.0f - size * c) / (size + c);
        value = (1.57079637f - mrd_arcs[k][0]) - ((t + mrd_odd_terms(t)) + (mrd_arcs[k][1] + 4.37113883e-8f));
    }
    return x < 0.0f ? -value : value;
}
