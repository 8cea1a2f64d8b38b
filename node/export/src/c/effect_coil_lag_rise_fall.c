/* The coil's current follows the drive with one lag while it rises and another while it falls.
   @needs finite elapsed_by lag
   @header */
typedef struct {
    mrd_elapsed elapsed;
    mrd_lag lag;
    mrd_lag_coefficients rise, fall;
} mrd_coil_lag_rise_fall_state;
/* @source */
/* @instance */
static double mrd_run_@K@(const mrd_parameters *p, mrd_chain *c, const mrd_model_inputs *in) {
    mrd_coil_lag_rise_fall_state *s = &c->effect_@K@;
    mrd_model_inputs own = *in;
    double since_s;
    if (!mrd_elapsed_by(&s->elapsed, in->drive, in->dt_s, &since_s)) {
        return mrd_finite(mrd_run_@J@(p, c, in));
    }
    if (mrd_is_nan(since_s)) {
        mrd_lag_rest(&s->lag, in->drive);
    } else {
        const bool grows = mrd_abs(in->drive) >= mrd_abs(s->lag.output);
        mrd_lag_coefficients *k = grows ? &s->rise : &s->fall;
        mrd_lag_update(k, grows ? p->@tau_rise_s@ : p->@tau_fall_s@, since_s);
        own.drive = mrd_lag_step(&s->lag, k, in->drive);
    }
    return mrd_finite(mrd_run_@J@(p, c, &own));
}
