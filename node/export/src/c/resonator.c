/* y'' = w^2 (q - y) - 2 b w y', by the bilinear transform, warped at w: the form `resonance` of a term.
   @needs sin min resonator_state
   @source */
static double mrd_resonator_step(mrd_resonator *s, double frequency_hz, double damping, double step_s, double q) {
    const double half = mrd_min(frequency_hz * (3.141592653589793 * step_s), 1.5);
    const double t = mrd_sin(half) / mrd_sin(half + 1.5707963267948966);
    double friction, square, next;
    if (!mrd_is_finite(q)) {
        return q;
    }
    if (t <= 0.0) {
        s->before = q;
        s->y = q;
        s->z = 0.0;
        return q;
    }
    friction = damping * t * 2.0;
    square = t * t;
    next = (s->z * (-friction - square + 1.0) + t * (q + s->before - s->y * 2.0)) / (friction + square + 1.0);
    s->before = q;
    s->y = s->y + t * (s->z + next);
    s->z = next;
    return s->y;
}
