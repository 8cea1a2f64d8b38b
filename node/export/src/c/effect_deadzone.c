/* Play between rod and damper: a gap in which the damper does not move.
   @needs finite elapsed_miss play sign scaled clamp
   @header */
typedef struct {
    mrd_elapsed elapsed;
    double x, y, share;
} mrd_deadzone_state;
/* @source */
/* @instance */
static double mrd_run_@K@(const mrd_parameters *p, mrd_chain *c, const mrd_model_inputs *in) {
    mrd_deadzone_state *s = &c->effect_@K@;
    const double x = in->displacement_m, v = in->velocity_m_s, half_m = p->@gap_m@ * 0.5;
    mrd_model_inputs own = *in;
    double y, share = 1.0;
    if (!(mrd_is_finite(x) && mrd_is_finite(v))) {
        mrd_miss(&s->elapsed, in->dt_s);
        (void)mrd_run_@J@(p, c, in);
        return mrd_nan();
    }
    if (mrd_is_nan(mrd_hit(&s->elapsed, in->dt_s))) {
        y = (v >= 0.0 && v <= 0.0) ? x : x - half_m * mrd_signum(v);
    } else {
        const double step_m = x - s->x;
        const double beyond_m = (x - s->y) * mrd_signum(step_m) - half_m;
        y = mrd_play(s->y, x, half_m);
        share = (step_m >= 0.0 && step_m <= 0.0) ? s->share : mrd_clamp(beyond_m / mrd_abs(step_m) + 0.5, 0.0, 1.0);
    }
    s->x = x;
    s->y = y;
    s->share = share;
    own.displacement_m = y;
    own.velocity_m_s = share * v;
    own.acceleration_m_s2 = share * in->acceleration_m_s2;
    return mrd_finite(mrd_scaled(mrd_run_@J@(p, c, &own), p->force_offset_n, share));
}
