/* F = sum_j w_j(i) f_j / sum_j w_j(i) + F0,   f_j = A1_j tanh(A3_j u_j) + A2_j u_j,   u_j = v + kappa_j x
   @needs sets tanh inputs
   @header */
typedef struct {
    char unused; /* the model has no memory */
} mrd_force_state;
/* @source */
#define MRD_HAS_SLOPE 1

static double mrd_force(const mrd_parameters *p, mrd_force_state *s, const mrd_model_inputs *in) {
    double strengths[MRD_SETS], force = 0.0;
    const double all = mrd_strengths(p, in->drive, strengths);
    int j;
    (void)s;
    for (j = 0; j < MRD_SETS; j++) {
        /* An unknown drive makes it NaN, which is neither above nor below zero. */
        if (!(strengths[j] <= 0.0)) {
            const double u = in->velocity_m_s + p->coupling_per_s[j] * in->displacement_m;
            force += strengths[j]
                * (p->yield_force_n[j] * mrd_tanh(p->pre_yield_slope_s_m[j] * u) + p->post_yield_damping_n_s_m[j] * u);
        }
    }
    return force / all + p->force_offset_n;
}
