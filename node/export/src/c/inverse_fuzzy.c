/* i = sum_r W_r f_r / sum_r W_r,   f_r = p_r x + q_r v + r_r Fd + s_r (Jang 1993): 2 x 4 x 3 rules over displacement, velocity and force.
   @needs tsk_gaussian tsk_share clamp finite inputs
   @source */
/* NaN if the current is not finite. */
static double mrd_current_for(const mrd_parameters *p, const mrd_model_inputs *in, double force_n, double way_n) {
    double u[3], w[3][4], mean[4] = { 0.0, 0.0, 0.0, 0.0 }, slopes = -0.0;
    int a, b, c, m, rule = 0;
    const double x_m = mrd_clamp(in->displacement_m, p->inverse_displacement_range_m[0], p->inverse_displacement_range_m[1]);
    const double v_m_s = mrd_clamp(in->velocity_m_s, -p->inverse_fastest_m_s, p->inverse_fastest_m_s);
    (void)way_n;
    u[0] = (x_m - p->inverse_displacement_mean_m) / p->inverse_displacement_scale_m;
    u[1] = (v_m_s - p->inverse_velocity_mean_m_s) / p->inverse_velocity_scale_m_s;
    u[2] = (force_n - p->inverse_force_mean_n) / p->inverse_force_scale_n;
    mrd_tsk_gaussian(p->inverse_displacement_sets, 2, mrd_clamp(u[0], -1e6, 1e6), w[0]);
    mrd_tsk_gaussian(p->inverse_velocity_sets, 4, mrd_clamp(u[1], -1e6, 1e6), w[1]);
    mrd_tsk_gaussian(p->inverse_force_sets, 3, mrd_clamp(u[2], -1e6, 1e6), w[2]);
    mrd_tsk_share(u[0], 2, w[0]);
    mrd_tsk_share(u[1], 4, w[1]);
    mrd_tsk_share(u[2], 3, w[2]);
    for (a = 0; a < 2; a++) {
        for (b = 0; b < 4; b++) {
            const double both = w[0][a] * w[1][b];
            for (c = 0; c < 3; c++) {
                const double weight = both * w[2][c];
                for (m = 0; m < 4; m++) {
                    mean[m] += weight * p->inverse_conclusions[rule][m];
                }
                rule++;
            }
        }
    }
    for (m = 0; m < 3; m++) {
        slopes += mean[m] * u[m];
    }
    /* The sum makes a negative zero positive, as the means of the service do. */
    return mrd_finite(slopes + mean[3] + 0.0);
}
