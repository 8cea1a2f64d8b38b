/* True for a negative number, and for a negative zero.
   @needs bits
   @source */
static bool mrd_has_minus(double x) {
    return (mrd_to_bits(x) >> 63) != 0U;
}
