/* f = sum_k b_k v^k, k = 0 to 6, with other coefficients for rising and falling velocity
   @needs inputs
   @source */
static double mrd_law(const double *p, const mrd_model_inputs *in, double *hidden) {
    const double *q = in->acceleration_m_s2 < 0.0 ? p + 7 : p;
    double sum = 0.0;
    int k;
    (void)hidden;
    if (mrd_is_nan(in->acceleration_m_s2)) {
        return in->acceleration_m_s2;
    }
    for (k = 6; k >= 0; k--) {
        sum = sum * in->velocity_m_s + q[k];
    }
    return sum;
}
