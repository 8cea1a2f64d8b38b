/* ARX with coefficients that depend on the drive (LPV), simulated: each coefficient is a sum over the copies with their weights.
   @needs regress  exp
   @source */
static double mrd_force(const mrd_parameters *p, mrd_force_state *s, const mrd_model_inputs *in) {
    double at[9], weights[MRD_COPIES], force_n = mrd_nan();
    bool is_ready;
    int copy, j;
    mrd_push_inputs(s, in);
    is_ready = mrd_known(s->drive, 1) && mrd_is_ready(s);
    if (is_ready) {
        mrd_weights(p, s->drive[0], weights);
        for (j = 0; j < 9; j++) {
            at[j] = 0.0;
        }
        for (copy = 0; copy < MRD_COPIES; copy++) {
            for (j = 0; j < 3; j++) {
                at[j] += weights[copy] * p->force_lags[copy][j];
                at[3 + j] += weights[copy] * p->displacement_lags_n_m[copy][j];
                at[6 + j] += weights[copy] * p->velocity_lags_n_s_m[copy][j];
            }
        }
        force_n = mrd_regress(p, s, at, at + 3, at + 6);
    }
    return mrd_keep_force(p, s, force_n, is_ready);
}
