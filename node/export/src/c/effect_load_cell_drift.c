/* The load cell drifts.
   @needs finite elapsed running_sum
   @header */
typedef struct {
    mrd_elapsed elapsed;
    mrd_running_sum time_s;
} mrd_load_cell_drift_state;
/* @source */
/* @instance */
static double mrd_run_@K@(const mrd_parameters *p, mrd_chain *c, const mrd_model_inputs *in) {
    mrd_load_cell_drift_state *s = &c->effect_@K@;
    const double since_s = mrd_hit(&s->elapsed, in->dt_s);
    if (mrd_is_nan(since_s)) {
        mrd_running_sum_begin(&s->time_s);
    } else {
        mrd_running_sum_add(&s->time_s, since_s);
    }
    return mrd_finite(mrd_run_@J@(p, c, in) + p->@rate_n_s@ * s->time_s.sum);
}
