/* The measured force is late.
   @needs finite elapsed_by ring
   @header */
typedef struct {
    mrd_elapsed elapsed;
    mrd_ring ring;
} mrd_sensor_delay_state;
/* @source */
/* @instance */
static double mrd_run_@K@(const mrd_parameters *p, mrd_chain *c, const mrd_model_inputs *in) {
    mrd_sensor_delay_state *s = &c->effect_@K@;
    const double force_n = mrd_run_@J@(p, c, in);
    double since_s;
    if (!mrd_elapsed_by(&s->elapsed, force_n, in->dt_s, &since_s)) {
        return mrd_nan();
    }
    if (mrd_is_nan(since_s)) {
        mrd_ring_restart(&s->ring, force_n);
    } else {
        mrd_ring_push(&s->ring, since_s, force_n);
    }
    return mrd_finite(mrd_ring_at(&s->ring, p->@delay_s@));
}
