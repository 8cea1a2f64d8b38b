/* mr_damper_sum.c: sums of doubles, rounded to the nearest, on an Arm processor without an FPU for double precision.
   Written by `mr-damper export`. For GCC; once in a program, also with several dampers.

   GCC's library (libgcc: __aeabi_dadd, __aeabi_dsub) gives some sums that are not the nearest number: the operands have opposite signs and
   exponents that are 33 apart, and the sum has a smaller exponent than its larger operand. The library then needs two bits below the last
   one of the larger operand, and keeps one. For -1 + 0x1.a1699fd7efc98p-33 it gives -0x1.fffffffe5e967p-1; the nearest is ...966p-1.

   Compile this file with the others, and link with
       -Wl,--wrap=__aeabi_dadd,--wrap=__aeabi_dsub
   A program can test at its start that this was done:
       bool mr_damper_sum_is_exact(void); */
#include <stdbool.h>
#include <stdint.h>

bool mr_damper_sum_is_exact(void);

bool mr_damper_sum_is_exact(void) {
    volatile double one = 1.0, small = 0x1.a1699fd7efc98p-33;
    volatile double sum = small + -one, difference = one - small;
    return sum == -0x1.fffffffe5e966p-1 && difference == 0x1.fffffffe5e966p-1;
}

#if defined(__arm__) && !(defined(__ARM_FP) && (__ARM_FP & 8))
/* Operands are in core registers, as the ABI demands of these routines. */
#define CORE __attribute__((pcs("aapcs")))

CORE double __real___aeabi_dadd(double a, double b);
CORE double __wrap___aeabi_dadd(double a, double b);
CORE double __wrap___aeabi_dsub(double a, double b);

typedef union {
    double value;
    uint64_t bits;
} both;

static inline both of(double value) {
    both own;
    own.value = value;
    return own;
}

/* The exponent; numbers below the normal ones have the least one. */
static inline int exponent(both number) {
    const int stored = (int)(number.bits >> 52) & 0x7FF;
    return stored + (stored == 0);
}

CORE double __wrap___aeabi_dadd(double a, double b) {
    const both x = of(a), y = of(b);
    const int apart = exponent(x) - exponent(y);
    if (((x.bits ^ y.bits) >> 63) != 0U && (apart == 33 || apart == -33)) {
        /* The smaller one in two parts. The first has the bits that the larger one can hold, so that their sum is exact. */
        both first = apart > 0 ? y : x, rest;
        const both larger = apart > 0 ? x : y;
        rest = first;
        first.bits &= ~UINT64_C(0x1FFFFFFFF);
        a = __real___aeabi_dadd(larger.value, first.value);
        first.bits ^= UINT64_C(0x8000000000000000);
        b = __real___aeabi_dadd(rest.value, first.value);
    }
    return __real___aeabi_dadd(a, b);
}

CORE double __wrap___aeabi_dsub(double a, double b) {
    both y = of(b);
    y.bits ^= UINT64_C(0x8000000000000000);
    return __wrap___aeabi_dadd(a, y.value);
}
#endif
