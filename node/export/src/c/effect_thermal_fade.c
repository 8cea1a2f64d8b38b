/* The fluid thins with the temperature: the force fades linearly from 25 degrees Celsius.
   @needs finite scaled
   @header */
/* @source */
/* @instance */
static double mrd_run_@K@(const mrd_parameters *p, mrd_chain *c, const mrd_model_inputs *in) {
    const double force_n = mrd_run_@J@(p, c, in);
    return mrd_finite(mrd_scaled(force_n, p->force_offset_n, p->@fade_per_k@ * (in->case_temp_c - 25.0) + 1.0));
}
