/* tanh z as networks take it.
   @needs tanh
   @source */
static float mrd_tanh_in_lanes(float z) {
    return mrd_tanh(z);
}
