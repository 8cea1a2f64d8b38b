/* Elastic end stops beyond a clearance.
   @needs finite
   @header */
/* @source */
/* @instance */
static double mrd_run_@K@(const mrd_parameters *p, mrd_chain *c, const mrd_model_inputs *in) {
    const double x = in->displacement_m, force_n = mrd_run_@J@(p, c, in);
    const double beyond_m = mrd_abs(x) <= p->@clearance_m@ ? 0.0 : mrd_abs(x) - p->@clearance_m@;
    return mrd_finite(force_n + p->@stiffness_n_m@ * (x < 0.0 ? -beyond_m : beyond_m));
}
