/* Divides the strengths by their sum; all are NaN for an unknown input. A single set always fires.
   @needs bits
   @source */
static void mrd_tsk_share(double u, int count, double *strengths) {
    double sum = -0.0;
    int j;
    for (j = 0; j < count; j++) {
        sum += strengths[j];
    }
    for (j = 0; j < count; j++) {
        strengths[j] = mrd_is_finite(u) ? (count == 1 ? 1.0 : strengths[j] / sum) : mrd_nan();
    }
}
