/* Infinity.
   @needs bits
   @source */
static float mrd_infinity(void) {
    return mrd_from_bits(UINT32_C(0x7f800000));
}
