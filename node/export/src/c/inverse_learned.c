/* The current for a force by an inverse that was learned from runs. The damper's range is that of the model at each sample. Where the
   learned inverse gives no current, the search on the model does.
   @needs inverse_search inverse_ends clamp inputs
   @source */
static bool mrd_solve(const mrd_parameters *p, const mrd_moment *m, const mrd_model_inputs *in, double demand_n, mrd_end last,
#if MRD_INVERSE_REMEMBERS
                      mrd_learned *learned,
#endif
                      mrd_solution *found) {
    double asked_n, current_a;
    bool is_clipped;
    mrd_ends ends;
    found->is_substituted = false;
    if (!mrd_take_ends(p, m, &ends, found)) {
        return false;
    }
    is_clipped = mrd_is_clipped(&ends, demand_n, found);
    /* The past forces of the learned inverse are within the range. The sum with zero is that of the service with a bias that has not been
       learnt. */
    asked_n = (is_clipped ? found->at.force_n : demand_n) + 0.0 - p->force_offset_n;
#if MRD_INVERSE_REMEMBERS
    current_a = mrd_learned_current(p, learned, in, asked_n);
#else
    current_a = mrd_learned_current(p, in, asked_n);
#endif
    if (is_clipped) {
        return true;
    }
    if (mrd_is_nan(current_a)) {
        found->is_substituted = true;
        return mrd_search(m, &ends, demand_n, last, found);
    }
    found->at.current_a = mrd_clamp(current_a, 0.0, p->inverse_current_max_a);
    found->at.force_n = mrd_moment_force(m, found->at.current_a);
    return !mrd_is_nan(found->at.force_n);
}
