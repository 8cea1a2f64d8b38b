/* Seals and guides add Coulomb friction, which changes its sign over a velocity of its own.
   @needs finite tanh
   @header */
/* @source */
/* @instance */
static double mrd_run_@K@(const mrd_parameters *p, mrd_chain *c, const mrd_model_inputs *in) {
    const double force_n = mrd_run_@J@(p, c, in);
    return mrd_finite(force_n + p->@friction_n@ * mrd_tanh(in->velocity_m_s / p->@sign_velocity_m_s@));
}
