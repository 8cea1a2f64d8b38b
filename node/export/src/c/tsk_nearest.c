/* Index of the set of a fuzzy input whose plateau is nearest to u. `width` numbers describe a set; its plateau reaches from number 1 to
   number `last`.
   @needs min max
   @source */
static int mrd_tsk_nearest(const double *numbers, int width, int last, int count, double u) {
    double least = 0.0;
    int j, best = 0;
    for (j = 0; j < count; j++) {
        const double b = numbers[j * width + 1], c = numbers[j * width + last];
        const double distance = mrd_max(mrd_min(b, c) - u, u - mrd_max(b, c));
        if (j == 0 || distance < least) {
            least = distance;
            best = j;
        }
    }
    return best;
}
