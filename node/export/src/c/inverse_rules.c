/* First-order rules on a full grid of Gaussian sets over three normalised inputs: sum_r W_r f_r / sum_r W_r, f_r linear in the inputs.
   @needs tsk_gaussian tsk_share clamp
   @source */
/* Weights of the sets of one input; their sum is one. */
static void mrd_rule_weights(const double (*sets)[2], int count, double u, double *weights) {
    mrd_tsk_gaussian(sets, count, mrd_clamp(u, -1e6, 1e6), weights);
    mrd_tsk_share(u, count, weights);
}

/* The normalised output for `counts` sets of each input. The first input's set varies slowest. */
static double mrd_rules(const double (*conclusions)[4], const int counts[3], const double u[3], double weights[3][4]) {
    double mean[4] = { 0.0, 0.0, 0.0, 0.0 }, slopes = -0.0;
    int a, b, c, m, rule = 0;
    for (a = 0; a < counts[0]; a++) {
        for (b = 0; b < counts[1]; b++) {
            const double both = weights[0][a] * weights[1][b];
            for (c = 0; c < counts[2]; c++) {
                const double weight = both * weights[2][c];
                for (m = 0; m < 4; m++) {
                    mean[m] += weight * conclusions[rule][m];
                }
                rule++;
            }
        }
    }
    for (m = 0; m < 3; m++) {
        slopes += mean[m] * u[m];
    }
    return slopes + mean[3];
}
