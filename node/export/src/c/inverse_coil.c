/* The lag of the coil, which the lead compensates.
   @needs exp_m1
   @source */
/* Share of its final value that a first-order lag of `tau_s` reaches in `dt_s`; 1 without a lag. */
static double mrd_approach(double dt_s, double tau_s) {
    return tau_s > 0.0 ? -mrd_exp_m1(-dt_s / tau_s) : 1.0;
}

static double mrd_coil_tau_s(const mrd_parameters *p, double from_a, double to_a) {
#if MRD_INVERSE_RISE_FALL
    return to_a >= from_a ? p->@COIL_RISE@ : p->@COIL_FALL@;
#else
    (void)from_a;
    (void)to_a;
    return p->@COIL_RISE@;
#endif
}
