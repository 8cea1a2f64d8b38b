/* Takagi-Sugeno-Kang fuzzy model on a full grid of rules.
   F = mean + std_dev sum_r W_r f_r / sum_r W_r + F0,   W_r a product of memberships, f_r linear in the normalised inputs or constant
   @needs tsk_share clamp inputs
   @header */
typedef struct {
    char unused; /* the model has no memory */
} mrd_force_state;
/* @source */
static double mrd_force(const mrd_parameters *p, mrd_force_state *s, const mrd_model_inputs *in) {
    double u[3] = { 0.0, 0.0, 0.0 }, w[3][5], mean[4] = { 0.0, 0.0, 0.0, 0.0 }, slopes = -0.0;
    int a, b, c, m, rule = 0;
    (void)s;
    w[0][0] = 1.0;
    w[1][0] = 1.0;
    w[2][0] = 1.0;
    mrd_tsk_fire(p, in, u, w);
    for (a = 0; a < MRD_SETS_1; a++) {
        for (b = 0; b < MRD_SETS_2; b++) {
            const double both = w[0][a] * w[1][b];
            for (c = 0; c < MRD_SETS_3; c++) {
                const double weight = both * w[2][c];
                for (m = 0; m < MRD_CONCLUSION; m++) {
                    mean[m] += weight * p->conclusions[rule][m];
                }
                rule++;
            }
        }
    }
    for (m = 0; m + 1 < MRD_CONCLUSION; m++) {
        slopes += mean[m] * u[m];
    }
    return p->force_mean_n + p->force_std_dev_n * (slopes + mean[MRD_CONCLUSION - 1]) + p->force_offset_n;
}
