#include "@NAME@.h"

/* The checks for NaN, and the order of sums and products, must stay as they are written. Clang shows -ffast-math and -ffinite-math-only. */
#if defined(__FAST_MATH__) || defined(__ASSOCIATIVE_MATH__) || defined(__RECIPROCAL_MATH__) || defined(__NO_SIGNED_ZEROS__)
#error "Compile without -ffast-math, -funsafe-math-optimizations and their parts: results would be other ones."
#endif
#if defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__ != 0
#error "Compile without -ffinite-math-only: it removes the checks for NaN."
#endif
/* Method 16 concerns half precision only. */
#if MRD_SINGLE
#if defined(__FLT_EVAL_METHOD__) && __FLT_EVAL_METHOD__ != 0 && __FLT_EVAL_METHOD__ != 16
#error "Compile for an FPU, or software, that computes float in float (FLT_EVAL_METHOD 0 or 16)."
#endif
#else
/* Method 1 computes float in double. */
#if defined(__FLT_EVAL_METHOD__) && __FLT_EVAL_METHOD__ != 0 && __FLT_EVAL_METHOD__ != 1 && __FLT_EVAL_METHOD__ != 16
#error "Compile for an FPU, or software, that computes double in double (FLT_EVAL_METHOD 0, 1 or 16)."
#endif
#endif
#if MRD_SINGLE
/* No fused multiplication and addition: results would differ from one compiler to the next. */
#else
/* No fused multiplication and addition: it rounds once where the service rounds twice. */
#endif
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__)
#pragma GCC optimize("fp-contract=off")
#endif
