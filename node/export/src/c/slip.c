/* Maxwell-slip model: a damping curve over velocity, bristles with memory, and a spring.
   f = sum_m d_m r_m(v) + sum_k b_k z_k + k x + o,   z_k <- s + (z_k - s) exp(-|v| dt/L_k),   s = sgn v
   @needs exp sign max min inputs infinity
   @header */
typedef struct {
    double deflections[5];
} mrd_force_state;
/* @source */
/* Parts of the way from 0 to v in each of eight segments, and the bristles advanced; false if the motion is not known. */
static bool mrd_slip_step(const mrd_parameters *p, mrd_force_state *s, const mrd_model_inputs *in, double ramps[8]) {
    const double x = in->displacement_m, v = in->velocity_m_s, speed = mrd_abs(v);
    double from = 0.0;
    int k;
    if (!(mrd_is_finite(x) && mrd_is_finite(v))) {
        return false;
    }
    for (k = 0; k < 5; k++) {
        if (mrd_is_nan(in->dt_s)) {
            s->deflections[k] = 0.0;
        } else if (v > 0.0 || v < 0.0) {
            const double way_m = speed * in->dt_s, slips = mrd_signum(v);
            s->deflections[k] = slips + (s->deflections[k] - slips) * mrd_exp(-way_m / p->bristle_lengths_m[k]);
        }
    }
    for (k = 0; k < 8; k++) {
        ramps[k] = 0.0;
    }
    for (k = 0; k < 4; k++) {
        const double to = k < 3 ? p->knot_speeds_m_s[k] : mrd_infinity();
        const double part = mrd_max(mrd_min(speed, to) - from, 0.0);
        ramps[v < 0.0 ? 3 - k : 4 + k] = part * mrd_signum(v);
        from = to;
    }
    return true;
}

static double mrd_slip_force(const mrd_parameters *p, const mrd_force_state *s, double x, const double ramps[8], int set) {
    double damping = -0.0, bristles = -0.0;
    int k;
    for (k = 0; k < 8; k++) {
        damping += p->damping_slopes_n_s_m[set][k] * ramps[k];
    }
    for (k = 0; k < 5; k++) {
        bristles += p->bristle_forces_n[set][k] * s->deflections[k];
    }
    return damping + bristles + p->stiffness_n_m[set] * x + p->set_offset_n[set];
}
