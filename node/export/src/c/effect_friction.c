/* Seals and guides add Coulomb friction.
   @needs finite smooth_sign
   @header */
/* @source */
/* @instance */
static double mrd_run_@K@(const mrd_parameters *p, mrd_chain *c, const mrd_model_inputs *in) {
    const double force_n = mrd_run_@J@(p, c, in);
    return mrd_finite(force_n + p->@friction_n@ * mrd_smooth_sign(in->velocity_m_s));
}
