/* Velocity by the parabola through three points, v_k = d_k + (d_k - d_(k-1)) dt_k/(dt_k + dt_(k-1)), d the backward difference.
   @needs bits
   @header */
typedef struct {
    double value, difference, dt_s;
    bool turned; /* true if there is a difference before */
} mrd_derivative;
/* @source */
static double mrd_derivative_step(mrd_derivative *s, const mrd_parameters *p, double dt_s, double value) {
    double difference, turned;
    (void)p;
    if (mrd_is_nan(dt_s)) {
        s->value = value;
        s->turned = false;
        return mrd_nan();
    }
    difference = (value - s->value) / dt_s;
    turned = s->turned ? (difference - s->difference) * dt_s / (dt_s + s->dt_s) : 0.0;
    s->value = value;
    s->difference = difference;
    s->dt_s = dt_s;
    s->turned = true;
    return difference + turned;
}
