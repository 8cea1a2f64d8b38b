/* First-order lag, tau dy/dt = u - y; exact for an input that is linear between samples.
   y_k = p y_(k-1) + (1 - q) u_k + (q - p) u_(k-1),   p = exp(-h/tau),   q = (1 - p) tau/h
   @needs exp_m1
   @header */
typedef struct {
    double input, output;
} mrd_lag;

typedef struct {
    double tau_s, step_s, pole, ramp; /* of the last step */
} mrd_lag_coefficients;
/* @source */
static void mrd_lag_rest(mrd_lag *s, double value) {
    s->input = value;
    s->output = value;
}

/* Recomputes the coefficients if the time constant or the step has changed. Without a lag the pole is zero. */
static void mrd_lag_update(mrd_lag_coefficients *k, double tau_s, double step_s) {
    if (mrd_to_bits(tau_s) == mrd_to_bits(k->tau_s) && mrd_to_bits(step_s) == mrd_to_bits(k->step_s)) {
        return;
    }
    k->tau_s = tau_s;
    k->step_s = step_s;
    if (tau_s > 0.0) {
        const double ratio = step_s / tau_s;
        k->pole = mrd_exp(-ratio);
        k->ramp = -mrd_exp_m1(-ratio) / ratio;
    } else {
        k->pole = 0.0;
        k->ramp = tau_s / step_s;
    }
}

static double mrd_lag_step(mrd_lag *s, const mrd_lag_coefficients *k, double input) {
    s->output = k->pole * s->output + (-k->ramp + 1.0) * input + (k->ramp - k->pole) * s->input;
    s->input = input;
    return s->output;
}
