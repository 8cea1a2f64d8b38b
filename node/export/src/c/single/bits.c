/* Bits of a number.
   @header
   @source */
typedef union {
    float value;
    uint32_t bits;
} mrd_bits;

static inline uint32_t mrd_to_bits(float value) {
    mrd_bits both;
    both.value = value;
    return both.bits;
}

static inline float mrd_from_bits(uint32_t bits) {
    mrd_bits both;
    both.bits = bits;
    return both.value;
}

static inline float mrd_nan(void) {
    return mrd_from_bits(UINT32_C(0x7fc00000));
}

static inline bool mrd_is_finite(float x) {
    return (mrd_to_bits(x) & UINT32_C(0x7f800000)) != UINT32_C(0x7f800000);
}

static inline bool mrd_is_nan(float x) {
    return (mrd_to_bits(x) & UINT32_C(0x7fffffff)) > UINT32_C(0x7f800000);
}

static inline float mrd_abs(float x) {
    return mrd_from_bits(mrd_to_bits(x) & UINT32_C(0x7fffffff));
}
