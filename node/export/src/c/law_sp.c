/* f = alpha tanh(delta u) + c u,   u = V0/X0 x + v
   @needs tanh inputs
   @source */
static double mrd_law(const double *p, const mrd_model_inputs *in, double *hidden) {
    const double u = p[3] / p[4] * in->displacement_m + in->velocity_m_s;
    (void)hidden;
    return p[0] * mrd_tanh(p[2] * u) + p[1] * u;
}
