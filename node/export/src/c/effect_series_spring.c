/* A spring in series with the damper: w = x - c (F - F0), F = f(w, w'), solved for F at each sample.
   @needs finite elapsed_miss infinity
   @header */
typedef struct {
    mrd_elapsed elapsed;
    double force_n, force_rate_n_s, slope; /* of the last sample */
} mrd_series_spring_state;
/* @source */
/* Differences from the solution, as shares of its size: one that is exact, and one from which a secant is exact. */
#if MRD_SINGLE
#define MRD_SPRING_EXACT 1e-6
#define MRD_SPRING_NEAR 1e-4
#else
#define MRD_SPRING_EXACT 1e-10
#define MRD_SPRING_NEAR 1e-7
#endif

/* The spring at one sample. */
typedef struct {
    double compliance_m_n, offset_n;
    bool has_before;
    double per_s, before_n, before_rate_n_s;
} mrd_spring;

static void mrd_spring_rates(const mrd_spring *a, double force_n, double *rate_n_s, double *rate_n_s2) {
    *rate_n_s = 0.0;
    *rate_n_s2 = 0.0;
    if (a->has_before) {
        *rate_n_s = (force_n - a->before_n) * a->per_s;
        *rate_n_s2 = (*rate_n_s - a->before_rate_n_s) * a->per_s;
    }
}

/* Inputs of the piston if the spring force is `force_n`. */
static mrd_model_inputs mrd_behind(const mrd_spring *a, const mrd_model_inputs *in, double force_n) {
    mrd_model_inputs own = *in;
    double rate_n_s, rate_n_s2;
    mrd_spring_rates(a, force_n, &rate_n_s, &rate_n_s2);
    own.displacement_m = in->displacement_m - a->compliance_m_n * (force_n - a->offset_n);
    own.velocity_m_s = in->velocity_m_s - a->compliance_m_n * rate_n_s;
    own.acceleration_m_s2 = in->acceleration_m_s2 - a->compliance_m_n * rate_n_s2;
    return own;
}

/* Newton iteration for model(F) = F. */
typedef struct {
    double force_n, at_n, slope, unsure;
} mrd_newton;
/* @instance */
/* Solves model(F) = F by secants within bounds; false if there is no such force. Trials start from the state before the sample. */
static bool mrd_solve_@K@(const mrd_parameters *p, mrd_chain *c, const mrd_model_inputs *in, const mrd_spring *a,
                          double guess_n, double *slope, double *found_n) {
    const double infinity = mrd_infinity();
    const mrd_chain kept = *c;
    double force_n = guess_n, low_n = -infinity, high_n = infinity, reach = 1.0, before_n = 0.0, excess_before_n = 0.0;
    int trial;
    for (trial = 0; trial < 48; trial++) {
        mrd_model_inputs piston;
        double model_n, excess_n, size_n, step_n;
        bool slow = false;
        const double at_n = force_n;
        if (trial > 0) {
            *c = kept;
        }
        piston = mrd_behind(a, in, force_n);
        model_n = mrd_run_@J@(p, c, &piston);
        if (!mrd_is_finite(model_n)) {
            return false;
        }
        excess_n = force_n - model_n;
        size_n = mrd_abs(at_n - a->offset_n) + 1.0;
        if (mrd_abs(excess_n) <= MRD_SPRING_EXACT * size_n || high_n - low_n <= MRD_SPRING_EXACT * size_n) {
            *found_n = force_n;
            return true;
        }
        if (excess_n < 0.0) {
            low_n = at_n;
        } else {
            high_n = at_n;
        }
        if (trial > 0) {
            const double secant = (excess_n - excess_before_n) / (at_n - before_n);
            *slope = secant > 0.0 ? secant : 1.0;
            if (secant > 0.0 && mrd_abs(excess_n) <= MRD_SPRING_NEAR * size_n) {
                *found_n = force_n - excess_n / *slope;
                return true;
            }
            slow = mrd_abs(excess_n) > 0.5 * mrd_abs(excess_before_n);
        }
        before_n = at_n;
        excess_before_n = excess_n;
        step_n = -excess_n / *slope;
        if (high_n - low_n < infinity) {
            const double next_n = force_n + step_n;
            const bool is_outside = next_n <= low_n || next_n >= high_n;
            force_n = (slow || is_outside) ? 0.5 * (low_n + high_n) : next_n;
        } else {
            reach = slow ? 2.0 * reach : 1.0;
            force_n = force_n + step_n * reach;
        }
    }
    *found_n = force_n;
    return high_n - low_n < infinity;
}

static double mrd_run_@K@(const mrd_parameters *p, mrd_chain *c, const mrd_model_inputs *in) {
    mrd_series_spring_state *s = &c->effect_@K@;
    const double compliance_m_n = p->@compliance_m_n@, offset_n = p->force_offset_n;
    const double since_s = mrd_since_s(&s->elapsed, in->dt_s);
    mrd_spring a;
    mrd_newton w;
    double force_n, rate_n_s, rate_n_s2;
    if (compliance_m_n >= 0.0 && compliance_m_n <= 0.0) {
        return mrd_finite(mrd_run_@J@(p, c, in));
    }
    a.compliance_m_n = compliance_m_n;
    a.offset_n = offset_n;
    a.has_before = !mrd_is_nan(since_s);
    a.per_s = 1.0 / since_s;
    a.before_n = s->force_n;
    a.before_rate_n_s = s->force_rate_n_s;
    w.force_n = a.has_before ? s->force_n + s->force_rate_n_s * since_s : offset_n;
    w.at_n = w.force_n;
    w.slope = a.has_before ? s->slope : 1.0;
    w.unsure = 1.0;
#if MRD_SPRING_NEWTON
    mrd_newton_search(p, &a, &w, in);
#endif
    force_n = w.force_n;
    if (w.unsure > 0.0) {
        double found_n = mrd_nan();
        if (!mrd_solve_@K@(p, c, in, &a, w.at_n, &w.slope, &found_n)) {
            mrd_miss(&s->elapsed, in->dt_s);
            return mrd_nan();
        }
        force_n = w.unsure < 1.0 ? w.force_n + (found_n - w.at_n) * w.unsure : found_n;
    }
    (void)mrd_hit(&s->elapsed, in->dt_s);
    s->force_n = force_n;
    mrd_spring_rates(&a, force_n, &rate_n_s, &rate_n_s2);
    s->force_rate_n_s = rate_n_s;
    s->slope = w.slope;
    return mrd_finite(force_n);
}
