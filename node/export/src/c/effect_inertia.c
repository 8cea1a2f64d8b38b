/* The moving mass adds m a.
   @needs finite 
   @header */
/* @source */
/* @instance */
static double mrd_run_@K@(const mrd_parameters *p, mrd_chain *c, const mrd_model_inputs *in) {
    const double force_n = mrd_run_@J@(p, c, in);
    return mrd_finite((p->@mass_kg@ >= 0.0 && p->@mass_kg@ <= 0.0) ? force_n : force_n + p->@mass_kg@ * in->acceleration_m_s2);
}
