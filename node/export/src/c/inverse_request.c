/* The demanded force is held between requests. A request that is refused cancels the one before it. The estimate does not depend on it, so
   no flag says that it was refused.
   @needs gate bits max
   @header */
typedef struct {
    mrd_gate gate;
    bool is_known;
    int64_t time_ns;
    double force_n;
} mrd_request;
/* @source */
static void mrd_take_request(const mrd_parameters *p, mrd_request *r, bool *is_requested, int64_t time_ns, double force_n) {
    bool is_refused = !mrd_is_finite(force_n) || mrd_abs(force_n) > p->force_max_n;
    if (mrd_is_nan(force_n)) {
        return; /* no request */
    }
    if (!is_refused) {
        is_refused = mrd_gate_check(&r->gate, time_ns) == MRD_REFUSE;
    }
    if (is_refused) {
        r->is_known = false;
        return;
    }
    *is_requested = true;
    r->is_known = true;
    r->time_ns = time_ns;
    r->force_n = force_n;
}

/* True for a measured current that the driver cannot have: it says nothing about the coil. */
static bool mrd_current_is_odd(const mrd_parameters *p, bool was_odd, bool has_before, double since_s, double before_a,
                               double current_a) {
    const double factor = was_odd ? 0.5 : 1.0, most_a = p->inverse_current_max_a;
    if (!(current_a >= -0.1 * factor * most_a && current_a <= (1.0 + 0.2 * factor) * most_a)) {
        return true;
    }
    /* Without a limit of the rate, no change is too fast. */
    return has_before && p->inverse_rate_max_a_s > 0.0
        && mrd_abs(current_a - before_a) > 1.5 * p->inverse_rate_max_a_s * since_s + 0.05 * most_a;
}
