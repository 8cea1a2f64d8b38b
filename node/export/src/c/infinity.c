/* Infinity.
   @needs bits
   @source */
static double mrd_infinity(void) {
    return mrd_from_bits(UINT64_C(0x7ff0000000000000));
}
