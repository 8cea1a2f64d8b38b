/* Two-sided Gaussian sets [left sigma, left centre, right sigma, right centre] of a fuzzy input, relative to the nearest one.
   @needs exp min max infinity
   @source */
static void mrd_tsk_two_sided(const double (*sets)[4], int count, double u, double *strengths) {
    double nearest = mrd_infinity();
    int j;
    for (j = 0; j < count; j++) {
        const double left = mrd_max((sets[j][1] - u) / sets[j][0], 0.0), right = mrd_max((u - sets[j][3]) / sets[j][2], 0.0);
        strengths[j] = 0.5 * (left * left + right * right);
        nearest = mrd_min(nearest, strengths[j]);
    }
    for (j = 0; j < count; j++) {
        strengths[j] = mrd_exp(nearest - strengths[j]);
    }
}
