/* Gaussian fuzzy sets over the drive, w_j = exp(-(i - c_j)^2/(2 sigma_j^2)), relative to the strongest set. A set with less than 1e-7 of
   the strongest is ignored.
   @needs exp min clamp infinity
   @source */
/* Strengths of the sets, and their sum. */
static double mrd_strengths(const mrd_parameters *p, double i, double strengths[MRD_SETS]) {
    double nearest = mrd_infinity(), sum = 0.0;
    int j;
    for (j = 0; j < MRD_SETS; j++) {
        const double sigma = p->@membership_sigma@[j];
        const double distance = i - p->@membership_centres@[j];
        strengths[j] = distance * distance * mrd_clamp(0.5 / (sigma * sigma), 1e-200, 1e200);
        nearest = mrd_min(nearest, strengths[j]);
    }
    for (j = 0; j < MRD_SETS; j++) {
        const double beyond = strengths[j] - nearest;
        strengths[j] = beyond > 16.11809565095832 ? 0.0 : mrd_exp(-beyond);
        sum += strengths[j];
    }
    return sum;
}
