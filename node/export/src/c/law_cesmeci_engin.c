/* f = c v + f_y 2/pi atan(k (v - v0 sgn(a))) + m a
   @needs atan inputs
   @source */
static double mrd_law(const double *p, const mrd_model_inputs *in, double *hidden) {
    const double a = in->acceleration_m_s2, v = in->velocity_m_s;
    const double shifted = -p[3] * (a < 0.0 ? -1.0 : 1.0) + v;
    (void)hidden;
    if (mrd_is_nan(a)) {
        return a;
    }
    return p[0] * v + p[1] * 0.6366197723675814 * mrd_atan(p[2] * shifted) + p[4] * a;
}
