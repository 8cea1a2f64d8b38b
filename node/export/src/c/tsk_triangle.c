/* Triangles [left foot, peak, right foot] of a fuzzy input, with shoulders at the ends; in a gap the nearest peak counts.
   @needs min max
   @source */
/* Index of the set whose plateau, from one number to the other, is nearest to u. */
static int mrd_tsk_nearest_triangle(const double (*sets)[3], int count, double u) {
    double least = 0.0;
    int j, best = 0;
    for (j = 0; j < count; j++) {
        const double low = mrd_min(sets[j][1], sets[j][1]), high = mrd_max(sets[j][1], sets[j][1]);
        const double distance = mrd_max(low - u, u - high);
        if (j == 0 || distance < least) {
            least = distance;
            best = j;
        }
    }
    return best;
}

static void mrd_tsk_triangle(const double (*sets)[3], int count, double u, double *strengths) {
    double sum = 0.0;
    int j;
    for (j = 0; j < count; j++) {
        const double peak = sets[j][1];
        const bool is_left = u <= peak;
        const double foot = is_left ? sets[j][0] : sets[j][2];
        const bool is_shoulder = is_left ? j == 0 : j + 1 == count;
        strengths[j] = (is_shoulder || (u >= peak && u <= peak)) ? 1.0 : mrd_max((u - foot) / (peak - foot), 0.0);
        sum += strengths[j];
    }
    if (sum <= 0.0) {
        strengths[mrd_tsk_nearest_triangle(sets, count, u)] = 1.0;
    }
}
