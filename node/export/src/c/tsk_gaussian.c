/* Gaussian sets [centre, sigma] of a fuzzy input, relative to the nearest one.
   @needs exp min infinity
   @source */
static void mrd_tsk_gaussian(const double (*sets)[2], int count, double u, double *strengths) {
    double nearest = mrd_infinity();
    int j;
    for (j = 0; j < count; j++) {
        const double distance = (u - sets[j][0]) / sets[j][1];
        strengths[j] = 0.5 * distance * distance;
        nearest = mrd_min(nearest, strengths[j]);
    }
    for (j = 0; j < count; j++) {
        strengths[j] = mrd_exp(nearest - strengths[j]);
    }
}
