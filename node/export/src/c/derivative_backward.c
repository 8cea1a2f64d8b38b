/* Velocity by the backward difference, v_k = (x_k - x_(k-1))/dt_k.
   @needs bits
   @header */
typedef struct {
    double value;
} mrd_derivative;
/* @source */
static double mrd_derivative_step(mrd_derivative *s, const mrd_parameters *p, double dt_s, double value) {
    const double before = s->value;
    (void)p;
    s->value = value;
    return mrd_is_nan(dt_s) ? mrd_nan() : (value - before) / dt_s;
}
