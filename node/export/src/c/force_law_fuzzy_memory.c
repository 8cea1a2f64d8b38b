/* Fuzzy sets over the drive, with one set of the law's parameters and hidden variables each. All hidden variables advance, also those of a
   set that does not count.
   @needs sets inputs
   @header */
typedef struct {
    double hidden[MRD_SETS][3];
} mrd_force_state;
/* @source */
static double mrd_force(const mrd_parameters *p, mrd_force_state *s, const mrd_model_inputs *in) {
    double strengths[MRD_SETS], q[MRD_LAW_PARAMETERS], force = 0.0;
    const double all = mrd_strengths(p, in->drive, strengths);
    int j;
    for (j = 0; j < MRD_SETS; j++) {
        const double weight = strengths[j] / all;
        double own;
        mrd_law_parameters(p, j, q);
        own = mrd_law(q, in, s->hidden[j]);
        if (!(weight <= 0.0)) {
            force = force + weight * own;
        }
    }
    return force + p->force_offset_n;
}
