/* Force of the model, and its derivative along a change of displacement and velocity, for the series spring.
   @needs force_fuzzy_tanh
   @source */
typedef struct {
    double strengths[MRD_SETS], all;
} mrd_along_drive;

static void mrd_force_and_slope(const mrd_parameters *p, const mrd_along_drive *at, const mrd_model_inputs *in,
                                double way_m, double way_m_s, double *force_n, double *slope) {
    double value = 0.0, growth = 0.0;
    const double share = 1.0 / at->all;
    int j;
    for (j = 0; j < MRD_SETS; j++) {
        if (!(at->strengths[j] <= 0.0)) {
            const double u = in->velocity_m_s + p->coupling_per_s[j] * in->displacement_m;
            const double step = mrd_tanh(p->pre_yield_slope_s_m[j] * u);
            const double by_u = p->yield_force_n[j] * p->pre_yield_slope_s_m[j] * (1.0 - step * step)
                + p->post_yield_damping_n_s_m[j];
            value += at->strengths[j] * (p->yield_force_n[j] * step + p->post_yield_damping_n_s_m[j] * u);
            growth += at->strengths[j] * (by_u * (way_m_s + p->coupling_per_s[j] * way_m));
        }
    }
    *force_n = value * share + p->force_offset_n;
    *slope = growth * share;
}
