/* Learned inverse rules: i = i_mean + i_s sum_r W_r f_r / sum_r W_r,   f_r = p_r v + q_r a + r_r Fd + s_r (Wang and Hu 2009): 3 x 3 x 3 rules
   over velocity, acceleration and demanded force.
   @needs inverse_rules finite inputs
   @source */
/* The current for `force_n` without the session's offset; NaN if it is not finite. */
static double mrd_learned_current(const mrd_parameters *p, const mrd_model_inputs *in, double force_n) {
    static const int counts[3] = { 3, 3, 3 };
    double u[3], weights[3][4];
    u[0] = (in->velocity_m_s - p->inverse_velocity_mean_m_s) / p->inverse_velocity_scale_m_s;
    u[1] = (in->acceleration_m_s2 - p->inverse_acceleration_mean_m_s2) / p->inverse_acceleration_scale_m_s2;
    u[2] = (force_n - p->inverse_force_mean_n) / p->inverse_force_scale_n;
    mrd_rule_weights(p->inverse_velocity_sets, counts[0], u[0], weights[0]);
    mrd_rule_weights(p->inverse_acceleration_sets, counts[1], u[1], weights[1]);
    mrd_rule_weights(p->inverse_force_sets, counts[2], u[2], weights[2]);
    /* The sum makes a negative zero positive, as that with the offset of the service does. */
    return mrd_finite(p->inverse_current_mean_a
                      + p->inverse_current_scale_a * mrd_rules(p->inverse_conclusions, counts, u, weights) + 0.0);
}
