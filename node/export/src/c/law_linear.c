/* f = c v + k x
   @needs inputs
   @source */
static double mrd_law(const double *p, const mrd_model_inputs *in, double *hidden) {
    (void)hidden;
    return p[0] * in->velocity_m_s + p[1] * in->displacement_m;
}
