/* Triangles [left foot, peak, right foot] of a fuzzy input, with shoulders at the ends; in a gap the nearest peak counts.
   @needs tsk_nearest max
   @source */
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
        strengths[mrd_tsk_nearest(&sets[0][0], 3, 1, count, u)] = 1.0;
    }
}
