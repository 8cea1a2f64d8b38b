/* Learned inverse network: i = i_mean + i_s (c_0 + sum_j c_j tanh(b_j + sum_n W_nj u_n)), u_n the normalised displacements, velocities and
   demanded forces of this sample and of those before, and the commanded currents of those before, each newest first.
   @needs tanh_in_lanes finite inputs
   @header */
typedef struct {
    bool begun; /* the samples below are not known (NaN) after a start */
    double displacement_m[MRD_INVERSE_LAGS], velocity_m_s[MRD_INVERSE_LAGS], force_n[MRD_INVERSE_LAGS];
    double current_a[MRD_INVERSE_CURRENT_LAGS];
} mrd_learned;
/* @source */
static void mrd_learned_push(double *slots, int lags, double value) {
    int j;
    for (j = lags - 1; j > 0; j--) {
        slots[j] = slots[j - 1];
    }
    slots[0] = value;
}

/* No past sample is known. */
static void mrd_learned_begin(mrd_learned *s) {
    int j;
    for (j = 0; j < MRD_INVERSE_LAGS; j++) {
        s->displacement_m[j] = mrd_nan();
        s->velocity_m_s[j] = mrd_nan();
        s->force_n[j] = mrd_nan();
    }
    for (j = 0; j < MRD_INVERSE_CURRENT_LAGS; j++) {
        s->current_a[j] = mrd_nan();
    }
    s->begun = true;
}

/* Normalises the lags; false if one of them is not known. */
static bool mrd_learned_take(double *u, const double *slots, int lags, double mean, double deviation) {
    bool is_known = true;
    int j;
    for (j = 0; j < lags; j++) {
        u[j] = (slots[j] - mean) / deviation;
        is_known = is_known && mrd_is_finite(slots[j]);
    }
    return is_known;
}

/* The current for `force_n` without the session's offset; NaN while a needed sample is not known. */
static double mrd_learned_current(const mrd_parameters *p, mrd_learned *s, const mrd_model_inputs *in, double force_n) {
    double u[MRD_INVERSE_INPUTS], sums[4] = { 0.0, 0.0, 0.0, 0.0 };
    int i, j;
    bool is_ready;
    /* The network holds at the sample period of its training, within a quarter. */
    if (!s->begun || !(mrd_abs(in->dt_s / p->inverse_sample_period_s - 1.0) <= 0.25)) {
        mrd_learned_begin(s);
    }
    mrd_learned_push(s->displacement_m, MRD_INVERSE_LAGS, in->displacement_m);
    mrd_learned_push(s->velocity_m_s, MRD_INVERSE_LAGS, in->velocity_m_s);
    mrd_learned_push(s->force_n, MRD_INVERSE_LAGS, force_n);
    is_ready = mrd_learned_take(u, s->displacement_m, MRD_INVERSE_LAGS, p->inverse_displacement_mean_m,
                                p->inverse_displacement_scale_m);
    is_ready = mrd_learned_take(u + MRD_INVERSE_LAGS, s->velocity_m_s, MRD_INVERSE_LAGS, p->inverse_velocity_mean_m_s,
                                p->inverse_velocity_scale_m_s) && is_ready;
    is_ready = mrd_learned_take(u + 2 * MRD_INVERSE_LAGS, s->force_n, MRD_INVERSE_LAGS, p->inverse_force_mean_n,
                                p->inverse_force_scale_n) && is_ready;
    is_ready = mrd_learned_take(u + 3 * MRD_INVERSE_LAGS, s->current_a, MRD_INVERSE_CURRENT_LAGS, p->inverse_current_mean_a,
                                p->inverse_current_scale_a) && is_ready;
    if (!is_ready) {
        return mrd_nan();
    }
    for (j = 0; j < MRD_INVERSE_HIDDEN; j++) {
        double sum = p->inverse_hidden_bias[j];
        for (i = 0; i < MRD_INVERSE_INPUTS; i++) {
            sum += u[i] * p->inverse_hidden_weights[i][j];
        }
        sums[j % 4] += mrd_tanh_in_lanes(sum) * p->inverse_output_weights[j];
    }
    return mrd_finite(p->inverse_current_mean_a
                      + p->inverse_current_scale_a
                            * ((((sums[0] + sums[1]) + sums[2]) + sums[3]) + p->inverse_output_bias));
}

/* Keeps the commanded current of this sample for the next ones. */
static void mrd_learned_feed(mrd_learned *s, double current_a) {
    mrd_learned_push(s->current_a, MRD_INVERSE_CURRENT_LAGS, current_a);
}
