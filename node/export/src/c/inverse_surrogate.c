/* The current for a force by a function that was fitted to the model. The damper's range is that of the model at each sample.
   @needs inverse_solution clamp inputs
   @source */
static bool mrd_solve(const mrd_parameters *p, const mrd_moment *m, const mrd_model_inputs *in, double demand_n, mrd_end last,
                      mrd_solution *found) {
    const double max_a = p->inverse_current_max_a;
    const double low_n = mrd_moment_force(m, 0.0), high_n = mrd_moment_force(m, max_a);
    double added_n, current_a;
    if (mrd_is_nan(low_n) || mrd_is_nan(high_n)) {
        return false;
    }
    found->achievable_n[0] = mrd_min(low_n, high_n);
    found->achievable_n[1] = mrd_max(low_n, high_n);
    if (!(found->achievable_n[0] < demand_n && demand_n < found->achievable_n[1])) {
        const bool near_low = mrd_abs(demand_n - low_n) <= mrd_abs(demand_n - high_n);
        found->at.current_a = near_low ? 0.0 : max_a;
        found->at.force_n = near_low ? low_n : high_n;
        return true;
    }
    added_n = mrd_moment_added(m);
    if (mrd_is_nan(added_n)) {
        return false;
    }
    current_a = mrd_current_for(p, in, demand_n - added_n, high_n - low_n);
    found->at.current_a = mrd_clamp(mrd_is_nan(current_a) ? last.current_a : current_a, 0.0, max_a);
    found->at.force_n = mrd_moment_force(m, found->at.current_a);
    return !mrd_is_nan(found->at.force_n);
}
