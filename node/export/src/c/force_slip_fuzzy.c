/* The Maxwell-slip model under fuzzy sets over the drive.
   @needs slip sets
   @source */
static double mrd_force(const mrd_parameters *p, mrd_force_state *s, const mrd_model_inputs *in) {
    double strengths[MRD_SETS], ramps[8], force = 0.0;
    const double all = mrd_strengths(p, in->drive, strengths);
    int j;
    if (!mrd_slip_step(p, s, in, ramps)) {
        return mrd_nan();
    }
    for (j = 0; j < MRD_SETS; j++) {
        /* An unknown drive makes it NaN, which is neither above nor below zero. */
        if (!(strengths[j] <= 0.0)) {
            force += strengths[j] * mrd_slip_force(p, s, in->displacement_m, ramps, j);
        }
    }
    return force / all + p->force_offset_n;
}
