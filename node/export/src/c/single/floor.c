/* The largest integer that is not above x.
   @needs bits
   @source */
static float mrd_floor(float x) {
    float whole;
    if (!(mrd_abs(x) < 8388608.0f)) {
        return x; /* an integer, infinite, or NaN */
    }
    whole = (float)(int32_t)x;
    return whole > x ? whole - 1.0f : whole;
}
