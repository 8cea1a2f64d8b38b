/* The damper's force at one motion, for any current: the tanh functions do not depend on it, and are computed once.
   @needs force_fuzzy_tanh finite
   @source */
typedef struct {
    const mrd_parameters *p;
    double forces_n[MRD_SETS];
    double added_n; /* by effects, which do not depend on the current either */
} mrd_moment;

static double mrd_still_force(const mrd_moment *m, double current_a) {
    double strengths[MRD_SETS], force = 0.0;
    const double all = mrd_strengths(m->p, current_a, strengths);
    int j;
    for (j = 0; j < MRD_SETS; j++) {
        if (!(strengths[j] <= 0.0)) {
            force += strengths[j] * m->forces_n[j];
        }
    }
    return force / all + m->p->force_offset_n;
}

static double mrd_moment_step(mrd_moment *m, const mrd_parameters *p, mrd_inverse_chain *chain, const mrd_model_inputs *in,
                              double current_a) {
    double alone_n;
#if MRD_INVERSE_BARE
    (void)chain;
#else
    double force_n;
    mrd_model_inputs own = *in;
#endif
    int j;
    m->p = p;
    m->added_n = 0.0;
    for (j = 0; j < MRD_SETS; j++) {
        const double u = in->velocity_m_s + p->coupling_per_s[j] * in->displacement_m;
        m->forces_n[j] = p->yield_force_n[j] * mrd_tanh(p->pre_yield_slope_s_m[j] * u) + p->post_yield_damping_n_s_m[j] * u;
    }
    alone_n = mrd_finite(mrd_still_force(m, current_a));
#if MRD_INVERSE_BARE
    return alone_n;
#else
    if (mrd_is_nan(alone_n)) {
        return alone_n;
    }
    own.drive = current_a;
    force_n = mrd_finite(mrd_run_@INVERSE@(p, chain, &own));
    m->added_n = force_n - alone_n;
    return force_n;
#endif
}

static double mrd_moment_force(const mrd_moment *m, double current_a) {
    return mrd_finite(mrd_still_force(m, current_a) + m->added_n);
}

#if MRD_INVERSE_ADDS
/* Force that the effects add at this moment, N. */
static double mrd_moment_added(const mrd_moment *m) {
    return m->added_n;
}
#endif
