/* A current with its force, and the damper's range.
   @needs bits min max
   @source */
typedef struct {
    double current_a, force_n;
} mrd_end;

typedef struct {
    mrd_end at;
    double achievable_n[2];
#if MRD_INVERSE_LEARNED
    bool is_substituted; /* the search gave the current, because the learned inverse gave none */
#endif
} mrd_solution;
