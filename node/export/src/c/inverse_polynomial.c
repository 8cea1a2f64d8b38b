/* i = (Fd - sum_k b_k u^k) / sum_k c_k u^k,   u = v / v_max within -1 and 1 (Choi, Lee, Park 2001); one set for a >= 0, another for a < 0.
   @needs bits clamp inputs
   @source */
static double mrd_horner(const double *terms, double u) {
    double sum = 0.0;
    int k;
    for (k = 6; k >= 0; k--) {
        sum = sum * u + terms[k];
    }
    return sum;
}

/* NaN where the polynomial gives no current. */
static double mrd_current_for(const mrd_parameters *p, const mrd_model_inputs *in, double force_n, double way_n) {
    const double u = mrd_clamp(in->velocity_m_s / p->inverse_fastest_m_s, -1.0, 1.0);
    double base_n, slope_n_a;
    if (mrd_is_nan(in->acceleration_m_s2)) {
        base_n = 0.5 * (mrd_horner(p->inverse_rising_n, u) + mrd_horner(p->inverse_falling_n, u));
        slope_n_a = 0.5 * (mrd_horner(p->inverse_rising_n_a, u) + mrd_horner(p->inverse_falling_n_a, u));
    } else if (in->acceleration_m_s2 < 0.0) {
        base_n = mrd_horner(p->inverse_falling_n, u);
        slope_n_a = mrd_horner(p->inverse_falling_n_a, u);
    } else {
        base_n = mrd_horner(p->inverse_rising_n, u);
        slope_n_a = mrd_horner(p->inverse_rising_n_a, u);
    }
    return slope_n_a * way_n > 0.0 ? (force_n - base_n) / slope_n_a : mrd_nan();
}
