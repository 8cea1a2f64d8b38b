/* f = c v + k x + alpha tanh(beta v + delta sign(x))
   @needs tanh inputs sign
   @source */
static double mrd_law(const double *p, const mrd_model_inputs *in, double *hidden) {
    const double x = in->displacement_m, v = in->velocity_m_s;
    const double side = (x <= 0.0 && x >= 0.0) ? 0.0 : mrd_signum(x);
    (void)hidden;
    return p[0] * v + p[1] * x + p[2] * mrd_tanh(p[3] * v + p[4] * side);
}
