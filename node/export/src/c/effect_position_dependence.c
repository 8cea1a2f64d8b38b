/* The force grows along the stroke.
   @needs finite scaled
   @header */
/* @source */
/* @instance */
static double mrd_run_@K@(const mrd_parameters *p, mrd_chain *c, const mrd_model_inputs *in) {
    const double force_n = mrd_run_@J@(p, c, in);
    return mrd_finite(mrd_scaled(force_n, p->force_offset_n, p->@growth_per_m@ * in->displacement_m + 1.0));
}
