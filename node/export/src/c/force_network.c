/* Autoregressive network, simulated: F = F0 + s (c_0 + sum_j c_j tanh(b_j + sum_i W_ij g_i)), g_i the normalised lags, or
   tanh(a_i u_i + d_i) of them.
   @needs history tanh_in_lanes
   @source */
static bool mrd_take(double *u, const double *slots, int lags, double mean, double deviation) {
    int j;
    for (j = 0; j < lags; j++) {
        u[j] = (slots[j] - mean) / deviation;
    }
    return mrd_known(slots, lags);
}

static double mrd_force(const mrd_parameters *p, mrd_force_state *s, const mrd_model_inputs *in) {
    double u[MRD_INPUTS], sums[4] = { 0.0, 0.0, 0.0, 0.0 }, force_n = mrd_nan();
#if MRD_HAS_DRIVE
    const int at = 3 * MRD_LAGS;
#else
    const int at = 2 * MRD_LAGS;
#endif
    int i, j;
    bool is_ready;
    mrd_push_inputs(s, in);
    is_ready = mrd_take(u, s->displacement_m, MRD_LAGS, p->displacement_mean_m, p->displacement_deviation_m);
    is_ready = mrd_take(u + MRD_LAGS, s->velocity_m_s, MRD_LAGS, p->velocity_mean_m_s, p->velocity_deviation_m_s) && is_ready;
#if MRD_HAS_DRIVE
    is_ready = mrd_take(u + 2 * MRD_LAGS, s->drive, MRD_LAGS, p->@drive_mean@, p->@drive_deviation@) && is_ready;
#endif
    is_ready = mrd_take(u + at, s->force_n, MRD_FORCE_LAGS, p->force_offset_n, p->force_deviation_n) && is_ready;
    if (is_ready) {
#if MRD_HAS_INPUT_NEURONS
        for (i = 0; i < MRD_INPUTS; i++) {
            u[i] = mrd_tanh_in_lanes(p->input_bias[i] + p->input_gain[i] * u[i]);
        }
#endif
        for (j = 0; j < MRD_HIDDEN; j++) {
            double sum = p->hidden_bias[j];
            for (i = 0; i < MRD_INPUTS; i++) {
                sum += u[i] * p->hidden_weights[i][j];
            }
            sums[j % 4] += mrd_tanh_in_lanes(sum) * p->output_weights[j];
        }
        force_n = p->force_offset_n + p->force_deviation_n * ((((sums[0] + sums[1]) + sums[2]) + sums[3]) + p->output_bias);
    }
    mrd_shift_in(s->force_n, is_ready ? force_n : p->force_offset_n);
    return force_n;
}
