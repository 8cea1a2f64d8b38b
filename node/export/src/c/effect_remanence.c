/* The core stays magnetised: the drive acts through a play operator.
   @needs finite elapsed_by play
   @header */
typedef struct {
    mrd_elapsed elapsed;
    double drive;
} mrd_remanence_state;
/* @source */
/* @instance */
static double mrd_run_@K@(const mrd_parameters *p, mrd_chain *c, const mrd_model_inputs *in) {
    mrd_remanence_state *s = &c->effect_@K@;
    mrd_model_inputs own = *in;
    double since_s;
    if (!mrd_elapsed_by(&s->elapsed, in->drive, in->dt_s, &since_s)) {
        return mrd_finite(mrd_run_@J@(p, c, in));
    }
    own.drive = mrd_is_nan(since_s) ? in->drive : mrd_play(s->drive, in->drive, p->@half_width_drive@);
    s->drive = own.drive;
    return mrd_finite(mrd_run_@J@(p, c, &own));
}
