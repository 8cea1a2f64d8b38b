/* The force follows with a lag.
   @needs finite elapsed_by lag
   @header */
typedef struct {
    mrd_elapsed elapsed;
    mrd_lag lag;
    mrd_lag_coefficients coefficients;
} mrd_force_lag_state;
/* @source */
/* @instance */
static double mrd_run_@K@(const mrd_parameters *p, mrd_chain *c, const mrd_model_inputs *in) {
    mrd_force_lag_state *s = &c->effect_@K@;
    const double force_n = mrd_run_@J@(p, c, in);
    double since_s;
    if (!mrd_elapsed_by(&s->elapsed, force_n, in->dt_s, &since_s)) {
        return mrd_nan();
    }
    if (mrd_is_nan(since_s)) {
        mrd_lag_rest(&s->lag, force_n);
        return force_n;
    }
    mrd_lag_update(&s->coefficients, p->@tau_s@, since_s);
    return mrd_finite(mrd_lag_step(&s->lag, &s->coefficients, force_n));
}
