/* Bits of a number.
   @header
   @source */
typedef union {
    double value;
    uint64_t bits;
} mrd_bits;

static inline uint64_t mrd_to_bits(double value) {
    mrd_bits both;
    both.value = value;
    return both.bits;
}

static inline double mrd_from_bits(uint64_t bits) {
    mrd_bits both;
    both.bits = bits;
    return both.value;
}

static inline double mrd_nan(void) {
    return mrd_from_bits(UINT64_C(0x7ff8000000000000));
}

static inline bool mrd_is_finite(double x) {
    return (mrd_to_bits(x) & UINT64_C(0x7ff0000000000000)) != UINT64_C(0x7ff0000000000000);
}

static inline bool mrd_is_nan(double x) {
    return (mrd_to_bits(x) & UINT64_C(0x7fffffffffffffff)) > UINT64_C(0x7ff0000000000000);
}

static inline double mrd_abs(double x) {
    return mrd_from_bits(mrd_to_bits(x) & UINT64_C(0x7fffffffffffffff));
}
