/* The current for a force by a function that was fitted to the model. The damper's range is that of the model at each sample.
   @needs inverse_ends clamp inputs
   @source */
static bool mrd_solve(const mrd_parameters *p, const mrd_moment *m, const mrd_model_inputs *in, double demand_n, mrd_end last,
                      mrd_solution *found) {
    const double max_a = p->inverse_current_max_a;
    double added_n, current_a;
    mrd_ends ends;
    if (!mrd_take_ends(p, m, &ends, found)) {
        return false;
    }
    if (mrd_is_clipped(&ends, demand_n, found)) {
        return true;
    }
    added_n = mrd_moment_added(m);
    if (mrd_is_nan(added_n)) {
        return false;
    }
    current_a = mrd_current_for(p, in, demand_n - added_n, ends.high.force_n - ends.low.force_n);
    found->at.current_a = mrd_clamp(mrd_is_nan(current_a) ? last.current_a : current_a, 0.0, max_a);
    found->at.force_n = mrd_moment_force(m, found->at.current_a);
    return !mrd_is_nan(found->at.force_n);
}
