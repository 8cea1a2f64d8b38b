/* Turbulence adds a force with the square of the velocity.
   @needs finite 
   @header */
/* @source */
/* @instance */
static double mrd_run_@K@(const mrd_parameters *p, mrd_chain *c, const mrd_model_inputs *in) {
    const double force_n = mrd_run_@J@(p, c, in);
    return mrd_finite(force_n + p->@quadratic_n_s2_m2@ * in->velocity_m_s * mrd_abs(in->velocity_m_s));
}
