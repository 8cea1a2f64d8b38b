/* The measured displacement is late.
   @needs finite
   @header */
/* @source */
/* @instance */
static double mrd_run_@K@(const mrd_parameters *p, mrd_chain *c, const mrd_model_inputs *in) {
    mrd_model_inputs own = *in;
    own.displacement_m = in->displacement_m - p->@delay_s@ * in->velocity_m_s;
    own.velocity_m_s = in->velocity_m_s - p->@delay_s@ * in->acceleration_m_s2;
    return mrd_finite(mrd_run_@J@(p, c, &own));
}
