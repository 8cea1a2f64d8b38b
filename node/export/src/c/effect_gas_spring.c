/* A gas spring in parallel adds k x.
   @needs finite 
   @header */
/* @source */
/* @instance */
static double mrd_run_@K@(const mrd_parameters *p, mrd_chain *c, const mrd_model_inputs *in) {
    const double force_n = mrd_run_@J@(p, c, in);
    return mrd_finite(force_n + p->@stiffness_n_m@ * in->displacement_m);
}
