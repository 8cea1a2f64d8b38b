/* Trapezoids [left foot, left shoulder, right shoulder, right foot] of a fuzzy input; in a gap the nearest plateau counts.
   @needs min max
   @source */
/* Index of the set whose plateau, from one number to the other, is nearest to u. */
static int mrd_tsk_nearest_trapezoid(const double (*sets)[4], int count, double u) {
    double least = 0.0;
    int j, best = 0;
    for (j = 0; j < count; j++) {
        const double low = mrd_min(sets[j][1], sets[j][2]), high = mrd_max(sets[j][1], sets[j][2]);
        const double distance = mrd_max(low - u, u - high);
        if (j == 0 || distance < least) {
            least = distance;
            best = j;
        }
    }
    return best;
}

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
        strengths[mrd_tsk_nearest_trapezoid(sets, count, u)] = 1.0;
    }
}
