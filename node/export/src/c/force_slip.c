/* The Maxwell-slip model without a drive.
   @needs slip
   @source */
static double mrd_force(const mrd_parameters *p, mrd_force_state *s, const mrd_model_inputs *in) {
    double ramps[8];
    if (!mrd_slip_step(p, s, in, ramps)) {
        return mrd_nan();
    }
    return mrd_slip_force(p, s, in->displacement_m, ramps, 0) + p->force_offset_n;
}
