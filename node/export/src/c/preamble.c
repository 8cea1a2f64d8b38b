#include "@NAME@.h"

#ifdef __FAST_MATH__
#error "Compile without -ffast-math: results would differ from the service's."
#endif
#if defined(__FLT_EVAL_METHOD__) && __FLT_EVAL_METHOD__ != 0
#error "Compile for an FPU, or software, that computes double in double (FLT_EVAL_METHOD 0)."
#endif
/* No fused multiplication and addition: it rounds once where the service rounds twice. */
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__)
#pragma GCC optimize("fp-contract=off")
#endif
