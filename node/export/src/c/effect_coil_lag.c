/* The coil's current follows the drive with a lag, tau di_e/dt = i - i_e.
   @needs finite elapsed_by lag
   @header */
typedef struct {
    mrd_elapsed elapsed;
    mrd_lag lag;
    mrd_lag_coefficients coefficients;
} mrd_coil_lag_state;
/* @source */
/* @instance */
static double mrd_run_@K@(const mrd_parameters *p, mrd_chain *c, const mrd_model_inputs *in) {
    mrd_coil_lag_state *s = &c->effect_@K@;
    mrd_model_inputs own = *in;
    double since_s;
    if (!mrd_elapsed_by(&s->elapsed, in->drive, in->dt_s, &since_s)) {
        return mrd_finite(mrd_run_@J@(p, c, in));
    }
    if (mrd_is_nan(since_s)) {
        mrd_lag_rest(&s->lag, in->drive);
    } else {
        mrd_lag_update(&s->coefficients, p->@tau_s@, since_s);
        own.drive = mrd_lag_step(&s->lag, &s->coefficients, in->drive);
    }
    return mrd_finite(mrd_run_@J@(p, c, &own));
}
