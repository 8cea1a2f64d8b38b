/* Fuzzy sets over the drive, with one set of the law's parameters each: F = sum_j w_j(i) f(p_j) / sum_j w_j(i) + F0
   @needs sets inputs
   @header */
typedef struct {
    char unused; /* the law has no memory */
} mrd_force_state;
/* @source */
static double mrd_force(const mrd_parameters *p, mrd_force_state *s, const mrd_model_inputs *in) {
    double strengths[MRD_SETS], q[MRD_LAW_PARAMETERS], hidden[3] = { 0.0, 0.0, 0.0 }, force = 0.0;
    const double all = mrd_strengths(p, in->drive, strengths);
    int j;
    (void)s;
    for (j = 0; j < MRD_SETS; j++) {
        /* An unknown drive makes it NaN, which is neither above nor below zero. */
        if (!(strengths[j] <= 0.0)) {
            mrd_law_parameters(p, j, q);
            force += strengths[j] * mrd_law(q, in, hidden);
        }
    }
    return force / all + p->force_offset_n;
}
