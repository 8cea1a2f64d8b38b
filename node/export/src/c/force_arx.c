/* Autoregression with exogenous inputs, simulated.
   @needs regress
   @source */
static double mrd_force(const mrd_parameters *p, mrd_force_state *s, const mrd_model_inputs *in) {
    double force_n = mrd_nan();
    bool is_ready;
    mrd_push_inputs(s, in);
    is_ready = mrd_is_ready(s);
#if MRD_HAS_DRIVE
    is_ready = is_ready && mrd_known(s->drive + MRD_DELAY, MRD_LAGS);
#endif
    if (is_ready) {
#if MRD_HAS_DRIVE
        int j;
#endif
        force_n = mrd_regress(p, s, p->force_lags, p->displacement_lags_n_m, p->velocity_lags_n_s_m);
#if MRD_HAS_DRIVE
        for (j = 0; j < MRD_LAGS; j++) {
            force_n += p->drive_lags[j] * s->drive[MRD_DELAY + j];
        }
#endif
    }
    return mrd_keep_force(p, s, force_n, is_ready);
}
