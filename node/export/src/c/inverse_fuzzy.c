/* i = sum_r W_r f_r / sum_r W_r,   f_r = p_r x + q_r v + r_r Fd + s_r (Jang 1993): 2 x 4 x 3 rules over displacement, velocity and force.
   @needs inverse_rules clamp finite inputs
   @source */
/* NaN if the current is not finite. */
static double mrd_current_for(const mrd_parameters *p, const mrd_model_inputs *in, double force_n, double way_n) {
    static const int counts[3] = { 2, 4, 3 };
    double u[3], weights[3][4];
    const double x_m = mrd_clamp(in->displacement_m, p->inverse_displacement_range_m[0], p->inverse_displacement_range_m[1]);
    const double v_m_s = mrd_clamp(in->velocity_m_s, -p->inverse_fastest_m_s, p->inverse_fastest_m_s);
    (void)way_n;
    u[0] = (x_m - p->inverse_displacement_mean_m) / p->inverse_displacement_scale_m;
    u[1] = (v_m_s - p->inverse_velocity_mean_m_s) / p->inverse_velocity_scale_m_s;
    u[2] = (force_n - p->inverse_force_mean_n) / p->inverse_force_scale_n;
    mrd_rule_weights(p->inverse_displacement_sets, counts[0], u[0], weights[0]);
    mrd_rule_weights(p->inverse_velocity_sets, counts[1], u[1], weights[1]);
    mrd_rule_weights(p->inverse_force_sets, counts[2], u[2], weights[2]);
    /* The sum makes a negative zero positive, as the means of the service do. */
    return mrd_finite(mrd_rules(p->inverse_conclusions, counts, u, weights) + 0.0);
}
