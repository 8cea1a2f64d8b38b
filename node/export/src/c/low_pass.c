/* Low-pass with two equal poles, H(s) = 1/(tau s + 1)^2, tau = 1/(2 pi f_c): two lags in a row with the same coefficients.
   @needs lag
   @header */
typedef struct {
    mrd_lag first, second;
    mrd_lag_coefficients coefficients;
} mrd_low_pass;
/* @source */
/* Time constant of a corner frequency, s. */
static double mrd_tau_s(double cutoff_hz) {
    return 1.0 / (6.283185307179586 * cutoff_hz);
}

static double mrd_low_pass_step(mrd_low_pass *s, double cutoff_hz, double dt_s, double value) {
    if (mrd_is_nan(dt_s)) {
        mrd_lag_rest(&s->first, value);
        mrd_lag_rest(&s->second, value);
        return value;
    }
    mrd_lag_update(&s->coefficients, mrd_tau_s(cutoff_hz), dt_s);
    return mrd_lag_step(&s->second, &s->coefficients, mrd_lag_step(&s->first, &s->coefficients, value));
}
