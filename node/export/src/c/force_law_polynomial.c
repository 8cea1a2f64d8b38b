/* The law with parameters that are polynomials in the drive, p_j(i) = c_j0 + c_j1 i + ...
   @needs inputs
   @header */
typedef struct {
    double hidden[3];
} mrd_force_state;
/* @source */
static double mrd_force(const mrd_parameters *p, mrd_force_state *s, const mrd_model_inputs *in) {
    double q[MRD_LAW_PARAMETERS], copy[MRD_LAW_PARAMETERS];
    int j, power;
    for (j = 0; j < MRD_LAW_PARAMETERS; j++) {
        q[j] = 0.0;
    }
    for (power = MRD_COPIES - 1; power >= 0; power--) {
        mrd_law_parameters(p, power, copy);
        for (j = 0; j < MRD_LAW_PARAMETERS; j++) {
            q[j] = q[j] * in->drive + copy[j];
        }
    }
    return mrd_law(q, in, s->hidden) + p->force_offset_n;
}
