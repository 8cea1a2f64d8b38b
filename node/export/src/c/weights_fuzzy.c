/* Weights of the fuzzy sets.
   @needs sets
   @source */
static void mrd_weights(const mrd_parameters *p, double i, double weights[MRD_SETS]) {
    const double all = mrd_strengths(p, i, weights);
    int j;
    for (j = 0; j < MRD_SETS; j++) {
        weights[j] = weights[j] / all;
    }
}
