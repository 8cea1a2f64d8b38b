/* Generalised bells [a, b, c] of a fuzzy input, 1/(1 + |(u - c)/a|^(2 b)); where all underflow, their logarithms are compared.
   @needs exp ln_1p min max infinity
   @source */
static void mrd_tsk_bell(const double (*sets)[3], int count, double u, double *strengths) {
    double nearest = mrd_infinity(), sum = 0.0;
    int j;
    for (j = 0; j < count; j++) {
        const double distance = mrd_abs((u - sets[j][2]) / sets[j][0]);
        strengths[j] = 1.0 / (1.0 + mrd_exp(2.0 * sets[j][1] * mrd_ln(distance)));
        sum += strengths[j];
    }
    if (sum < 1e-100) {
        for (j = 0; j < count; j++) {
            const double t = 2.0 * sets[j][1] * mrd_ln(mrd_abs((u - sets[j][2]) / sets[j][0]));
            strengths[j] = mrd_max(t, 0.0) + mrd_ln_1p(mrd_exp(-mrd_abs(t)));
            nearest = mrd_min(nearest, strengths[j]);
        }
        for (j = 0; j < count; j++) {
            strengths[j] = mrd_exp(nearest - strengths[j]);
        }
    }
}
