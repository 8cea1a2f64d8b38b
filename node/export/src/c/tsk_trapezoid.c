/* Trapezoids [left foot, left shoulder, right shoulder, right foot] of a fuzzy input; in a gap the nearest plateau counts.
   @needs tsk_nearest min max
   @source */
static void mrd_tsk_trapezoid(const double (*sets)[4], int count, double u, double *strengths) {
    double sum = 0.0;
    int j;
    for (j = 0; j < count; j++) {
        const double *n = sets[j];
        const double rise = u >= n[1] ? 1.0 : mrd_max((u - n[0]) / (n[1] - n[0]), 0.0);
        const double fall = u <= n[2] ? 1.0 : mrd_max((n[3] - u) / (n[3] - n[2]), 0.0);
        strengths[j] = mrd_min(rise, fall);
        sum += strengths[j];
    }
    if (sum <= 0.0) {
        strengths[mrd_tsk_nearest(&sets[0][0], 4, 2, count, u)] = 1.0;
    }
}
