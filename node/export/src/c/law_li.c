/* f = alpha tanh(beta/2 (v - v0)) + c v + k x, with other parameters for rising and falling velocity
   @needs tanh inputs
   @source */
static double mrd_law(const double *p, const mrd_model_inputs *in, double *hidden) {
    const double a = in->acceleration_m_s2, v = in->velocity_m_s;
    const double *q = a < 0.0 ? p + 5 : p;
    (void)hidden;
    if (mrd_is_nan(a)) {
        return a;
    }
    return q[0] * mrd_tanh(q[1] * 0.5 * (-q[2] + v)) + q[3] * v + q[4] * in->displacement_m;
}
