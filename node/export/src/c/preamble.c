#include "@NAME@.h"

#ifdef __FAST_MATH__
#if MRD_SINGLE
#error "Compile without -ffast-math: it removes the checks for NaN."
#else
#error "Compile without -ffast-math: results would differ from the service's."
#endif
#endif
#if defined(__FLT_EVAL_METHOD__) && __FLT_EVAL_METHOD__ != 0
#if MRD_SINGLE
#error "Compile for an FPU, or software, that computes float in float (FLT_EVAL_METHOD 0)."
#else
#error "Compile for an FPU, or software, that computes double in double (FLT_EVAL_METHOD 0)."
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
