/* The current for a force: a bracketed search on the model (regula falsi with the Illinois modification, Dowell and Jarratt 1971), or its
   closed form if the force is linear in the current. At most 30 steps in a bracket.
   @needs inverse_ends clamp
   @source */
#if MRD_INVERSE_LINEAR
#else
static double mrd_excess(const mrd_end *at, double demand_n) {
    return at->force_n - demand_n;
}

static mrd_end mrd_nearer(mrd_end a, mrd_end b, double demand_n) {
    return mrd_abs(mrd_excess(&a, demand_n)) <= mrd_abs(mrd_excess(&b, demand_n)) ? a : b;
}

/* The point between two currents where the force is `demand_n`; the nearer end if the demand is outside. False without a force. */
static bool mrd_bracketed(const mrd_moment *m, double demand_n, mrd_end from, mrd_end to, double near_n, mrd_end *found) {
    const double near_a = 1e-4 * mrd_abs(to.current_a - from.current_a);
    double excess_a = mrd_excess(&from, demand_n), excess_b = mrd_excess(&to, demand_n);
    double width_a = mrd_abs(to.current_a - from.current_a);
    int step, steps_since = 0;
    if (excess_a * excess_b > 0.0 || mrd_abs(excess_a) <= near_n || mrd_abs(excess_b) <= near_n) {
        *found = mrd_nearer(from, to, demand_n);
        return true;
    }
    for (step = 0; step < 30; step++) {
        const double secant = (from.current_a * excess_b - to.current_a * excess_a) / (excess_b - excess_a);
        const double middle = 0.5 * (from.current_a + to.current_a);
        const double least = mrd_min(from.current_a, to.current_a), most = mrd_max(from.current_a, to.current_a);
        mrd_end next;
        double excess, width;
        next.current_a = (steps_since >= 2 || !(secant > least && secant < most)) ? middle : secant;
        next.force_n = mrd_moment_force(m, next.current_a);
        if (mrd_is_nan(next.force_n)) {
            return false;
        }
        excess = mrd_excess(&next, demand_n);
        if (mrd_abs(excess) <= near_n) {
            *found = next;
            return true;
        }
        if ((excess > 0.0) == (excess_a > 0.0)) {
            from = next;
            excess_a = excess;
            excess_b *= 0.5;
        } else {
            to = next;
            excess_b = excess;
            excess_a *= 0.5;
        }
        width = mrd_abs(to.current_a - from.current_a);
        if (width <= near_a) {
            break;
        }
        if (width <= 0.5 * width_a) {
            width_a = width;
            steps_since = 0;
        } else {
            steps_since++;
        }
    }
    *found = mrd_nearer(from, to, demand_n);
    return true;
}
#endif

/* The current within `ends`. Their range is in `found`; the search extends it where the force turns back. */
static bool mrd_search(const mrd_moment *m, const mrd_ends *ends, double demand_n, mrd_end last, mrd_solution *found) {
#if MRD_INVERSE_LINEAR
    const double way_n = ends->high.force_n - ends->low.force_n;
    /* If the current has no effect, zero current is as good as any. */
    const double share = (way_n >= 0.0 && way_n <= 0.0) ? 0.0 : mrd_clamp((demand_n - ends->low.force_n) / way_n, 0.0, 1.0);
    (void)m;
    (void)last;
    found->at.current_a = share * ends->high.current_a;
    found->at.force_n = ends->low.force_n + share * way_n;
    return true;
#endif
#if MRD_INVERSE_BRACKET
    const double near_n = 1e-4 * (found->achievable_n[1] - found->achievable_n[0]);
    mrd_end from = ends->low, to = ends->high;
    /* The last current is usually near, and its force is known. */
    if (last.current_a > 0.0 && last.current_a < ends->high.current_a) {
        if ((demand_n - ends->low.force_n) * (demand_n - last.force_n) <= 0.0) {
            to = last;
        } else if ((demand_n - last.force_n) * (demand_n - ends->high.force_n) <= 0.0) {
            from = last;
        }
    }
    return mrd_bracketed(m, demand_n, from, to, near_n, &found->at);
#endif
#if MRD_INVERSE_FOLDED
    /* The force is not monotonic in the current: eight parts. */
    mrd_end before = ends->low;
    bool has_best = false;
    int part;
    for (part = 1; part <= 8; part++) {
        mrd_end here = ends->high, own;
        double near_n, miss_n, best_n;
        if (part < 8) {
            here.current_a = ((double)part / 8.0) * ends->high.current_a;
            here.force_n = mrd_moment_force(m, here.current_a);
            if (mrd_is_nan(here.force_n)) {
                return false;
            }
        }
        found->achievable_n[0] = mrd_min(found->achievable_n[0], here.force_n);
        found->achievable_n[1] = mrd_max(found->achievable_n[1], here.force_n);
        near_n = 1e-4 * (found->achievable_n[1] - found->achievable_n[0]);
        if (!mrd_bracketed(m, demand_n, before, here, near_n, &own)) {
            return false;
        }
        /* Better: nearer to the demand by more than the tolerance, or equally near and nearer to the last current. */
        miss_n = mrd_max(mrd_abs(own.force_n - demand_n) - near_n, 0.0);
        best_n = has_best ? mrd_max(mrd_abs(found->at.force_n - demand_n) - near_n, 0.0) : 0.0;
        if (!has_best || miss_n < best_n
            || (miss_n <= best_n
                && mrd_abs(own.current_a - last.current_a) < mrd_abs(found->at.current_a - last.current_a))) {
            found->at = own;
            has_best = true;
        }
        before = here;
    }
    return has_best;
#endif
}
#if MRD_INVERSE_LEARNED
#else

static bool mrd_solve(const mrd_parameters *p, const mrd_moment *m, const mrd_model_inputs *in, double demand_n, mrd_end last,
                      mrd_solution *found) {
    mrd_ends ends;
    (void)in;
    return mrd_take_ends(p, m, &ends, found) && mrd_search(m, &ends, demand_n, last, found);
}
#endif
