/* f = alpha 2/pi atan(delta u) + c u,   u = V0/X0 x + v
   @needs atan inputs
   @source */
static double mrd_law(const double *p, const mrd_model_inputs *in, double *hidden) {
    const double u = p[3] / p[4] * in->displacement_m + in->velocity_m_s;
    (void)hidden;
    return p[0] * 0.6366197723675814 * mrd_atan(p[2] * u) + p[1] * u;
}
