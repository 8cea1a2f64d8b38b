/* The law with constant parameters.
   @needs inputs
   @header */
typedef struct {
    double hidden[3];
} mrd_force_state;
/* @source */
static double mrd_force(const mrd_parameters *p, mrd_force_state *s, const mrd_model_inputs *in) {
    double q[MRD_LAW_PARAMETERS];
    mrd_law_parameters(p, 0, q);
    return mrd_law(q, in, s->hidden) + p->force_offset_n;
}
