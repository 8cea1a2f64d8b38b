/* F_k = F0 + sum_j a_j (F_(k-j) - F0) + b_j x + c_j v over the lags, for an autoregressive model in simulation.
   @needs history
   @source */
static bool mrd_is_ready(const mrd_force_state *s) {
    return mrd_known(s->force_n, MRD_LAGS) && mrd_known(s->displacement_m + MRD_DELAY, MRD_LAGS)
        && mrd_known(s->velocity_m_s + MRD_DELAY, MRD_LAGS);
}

static double mrd_regress(const mrd_parameters *p, const mrd_force_state *s, const double *force, const double *x,
                          const double *v) {
    const double *displacement_m = s->displacement_m + MRD_DELAY, *velocity_m_s = s->velocity_m_s + MRD_DELAY;
    double force_n = p->force_offset_n;
    int j;
    for (j = 0; j < MRD_LAGS; j++) {
        force_n += force[j] * (s->force_n[j] - p->force_offset_n) + x[j] * displacement_m[j] + v[j] * velocity_m_s[j];
    }
    return force_n;
}

/* Keeps the force for the next sample. Without a prediction it is the offset: the neutral start of a simulation. */
static double mrd_keep_force(const mrd_parameters *p, mrd_force_state *s, double force_n, bool is_ready) {
    mrd_shift_in(s->force_n, is_ready ? force_n : p->force_offset_n);
    return is_ready ? force_n : mrd_nan();
}
