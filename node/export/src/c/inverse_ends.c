/* The damper's forces at one motion without current and at the largest current. A demand that does not lie between them gets the nearer
   end.
   @needs inverse_solution bits min max
   @source */
typedef struct {
    mrd_end low, high;
} mrd_ends;

/* The two ends, and the damper's range between them; what is found is the low end so far. False if the model has no force. */
static bool mrd_take_ends(const mrd_parameters *p, const mrd_moment *m, mrd_ends *ends, mrd_solution *found) {
    ends->low.current_a = 0.0;
    ends->low.force_n = mrd_moment_force(m, 0.0);
    ends->high.current_a = p->inverse_current_max_a;
    ends->high.force_n = mrd_moment_force(m, ends->high.current_a);
    found->at = ends->low;
    found->achievable_n[0] = mrd_min(ends->low.force_n, ends->high.force_n);
    found->achievable_n[1] = mrd_max(ends->low.force_n, ends->high.force_n);
    return !mrd_is_nan(ends->low.force_n) && !mrd_is_nan(ends->high.force_n);
}
#if MRD_INVERSE_CLIPS

/* True if the demand does not lie between the ends: then the nearer end is found. */
static bool mrd_is_clipped(const mrd_ends *ends, double demand_n, mrd_solution *found) {
    const double low_miss_n = mrd_abs(demand_n - ends->low.force_n), high_miss_n = mrd_abs(demand_n - ends->high.force_n);
    if (found->achievable_n[0] < demand_n && demand_n < found->achievable_n[1]) {
        return false;
    }
    found->at = low_miss_n <= high_miss_n ? ends->low : ends->high;
    return true;
}
#endif
