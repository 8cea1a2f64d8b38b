/* The inverse controller: from a demanded force to a current, sample by sample.
   P = F0 + k x;   Fd (v) is dissipative if (Fd - P) v >= 0;   F(i*) = Fd within 0 and i_max;   lead for the coil's lag;   rate;   range
   @needs clamp min max finite inputs inverse_request infinity
   @header */
typedef struct {
    mrd_request request;
    bool is_requested; /* a force has been requested at least once */
    bool has_begun;    /* false before the first command: the currents below are the safe one */
    bool goes_safe;
    double safe_rate_a_s;
    double last_a, target_a; /* last command, and last target for the fluid */
    double fluid_a;          /* that acts on the fluid */
#if MRD_INVERSE_REMEMBERS
    mrd_learned learned; /* past samples of the learned inverse: only consecutive ones with a demanded force */
#endif
    mrd_inverse_chain chain;
} mrd_inverse;
/* @source */
/* A sample, as the controller sees it. */
typedef struct {
    mrd_model_inputs in;
    double step_s; /* since the displacement before, also over a gap; NaN if there is none */
} mrd_moving;

/* The current in the fluid `dt_s` after the driver went to `driver_a`. */
static double mrd_after(const mrd_parameters *p, const mrd_inverse *s, double driver_a, double dt_s) {
#if MRD_INVERSE_HAS_COIL
    if (!mrd_is_nan(dt_s)) {
        const double share = mrd_approach(dt_s, mrd_coil_tau_s(p, s->fluid_a, driver_a));
        return s->fluid_a + share * (driver_a - s->fluid_a);
    }
#else
    (void)p;
    (void)s;
    (void)dt_s;
#endif
    return driver_a;
}

/* Largest change of the current within `dt_s` at `rate_a_s`. */
static double mrd_most_change_a(double rate_a_s, double dt_s) {
    if (rate_a_s > 1.7976931348623157e308) {
        return rate_a_s;
    }
    return mrd_is_nan(dt_s) ? 0.0 : rate_a_s * dt_s;
}

static double mrd_rate_max_a_s(const mrd_parameters *p) {
    return p->inverse_rate_max_a_s > 0.0 ? p->inverse_rate_max_a_s : mrd_infinity();
}

/* Before each command. A largest current that was lowered holds at once, also for the command before, from which the rate is limited. */
static void mrd_begin(const mrd_parameters *p, mrd_inverse *s) {
    if (!s->has_begun) {
        s->has_begun = true;
        s->last_a = mrd_clamp(p->inverse_safe_a, 0.0, p->inverse_current_max_a);
        s->target_a = s->last_a;
        s->fluid_a = s->last_a;
    }
    s->last_a = mrd_min(s->last_a, p->inverse_current_max_a);
    s->target_a = mrd_min(s->target_a, p->inverse_current_max_a);
}

/* Goes towards the safe current. */
static void mrd_go_safe(const mrd_parameters *p, mrd_inverse *s, double dt_s) {
    const double way_a = p->inverse_safe_a - s->last_a;
    double most_a;
    if (!s->goes_safe) {
        s->goes_safe = true;
        s->safe_rate_a_s = mrd_min(mrd_abs(way_a) / p->inverse_safe_after_s, mrd_rate_max_a_s(p));
    }
    most_a = mrd_most_change_a(s->safe_rate_a_s, dt_s);
    s->last_a = mrd_clamp(s->last_a + mrd_clamp(way_a, -most_a, most_a), 0.0, p->inverse_current_max_a);
    s->target_a = s->last_a;
#if MRD_INVERSE_REMEMBERS
    s->learned = (mrd_learned){ 0 };
#endif
}

/* A command without forces. */
static void mrd_without_forces(const mrd_inverse *s, double demand_n, mrd_output *out) {
    out->current_a = s->last_a;
    out->requested_n = demand_n;
    out->expected_n = mrd_nan();
    out->achievable_n[0] = mrd_nan();
    out->achievable_n[1] = mrd_nan();
    out->is_achievable = false;
    out->is_dissipative = false;
    out->limited_by = MRD_LIMITED_BY_SAFE;
#if MRD_INVERSE_LEARNED
    out->is_substituted = false;
#endif
}

/* The current for a force. */
static void mrd_track(const mrd_parameters *p, mrd_inverse *s, const mrd_model_inputs *in, double dt_s, double demand_n,
                      const mrd_moment *moment, double modelled_n, mrd_output *out) {
    const double x_m = in->displacement_m, v_m_s = in->velocity_m_s;
    double moves_n, slack_n, led_a, inside_a, most_a, cut_a, fluid_a, expected_n;
    bool near_rest;
    mrd_solution solved;
    mrd_end last;
    last.current_a = s->fluid_a;
    last.force_n = modelled_n;
    /* The sums with zero are those of the service with a bias that has not been learnt: they make a negative zero positive. */
#if MRD_INVERSE_REMEMBERS
    if (!mrd_solve(p, moment, in, demand_n + 0.0, last, &s->learned, &solved)) {
#else
    if (!mrd_solve(p, moment, in, demand_n + 0.0, last, &solved)) {
#endif
        mrd_go_safe(p, s, dt_s);
        mrd_without_forces(s, demand_n, out);
        return;
    }
    s->goes_safe = false;
    out->requested_n = demand_n;
#if MRD_INVERSE_LEARNED
    out->is_substituted = solved.is_substituted;
#endif
    out->is_dissipative = (demand_n - (p->force_offset_n + (@STIFFNESS@) * x_m)) * v_m_s >= 0.0;
    out->achievable_n[0] = solved.achievable_n[0] + 0.0;
    out->achievable_n[1] = solved.achievable_n[1] + 0.0;
    moves_n = out->achievable_n[1] - out->achievable_n[0];
    slack_n = 1e-3 * moves_n;
    out->is_achievable = out->is_dissipative && demand_n >= out->achievable_n[0] - slack_n && demand_n <= out->achievable_n[1] + slack_n;
    /* Near rest the sign of the force reverses and its size hardly depends on the current: the last target is held. */
    near_rest = mrd_abs(v_m_s) < p->inverse_hold_m_s || moves_n < 0.01 * p->inverse_force_most_n;
    if (!near_rest) {
        s->target_a = out->is_dissipative ? solved.at.current_a : 0.0;
    }
    if (!out->is_dissipative) {
        out->limited_by = MRD_LIMITED_BY_PASSIVITY;
    } else if (out->is_achievable) {
        out->limited_by = MRD_LIMITED_BY_NONE;
    } else {
        out->limited_by =
            solved.at.current_a > 0.5 * p->inverse_current_max_a ? MRD_LIMITED_BY_CURRENT_MAX : MRD_LIMITED_BY_CURRENT_MIN;
    }
    led_a = s->target_a;
#if MRD_INVERSE_HAS_COIL
#if MRD_INVERSE_LEARNED
    /* A learned inverse gives the driver's current; the search gives the current in the fluid. */
    if (solved.is_substituted && !mrd_is_nan(dt_s)) {
#else
    if (!mrd_is_nan(dt_s)) {
#endif
        /* A lead slower than the coil would only delay it. */
        const double way_a = s->target_a - s->fluid_a, tau_s = mrd_coil_tau_s(p, s->fluid_a, s->target_a);
        led_a = s->fluid_a + way_a * mrd_approach(dt_s, mrd_min(p->inverse_lead_s, tau_s)) / mrd_approach(dt_s, tau_s);
    }
#endif
    if (!out->is_dissipative) {
        led_a = mrd_min(led_a, s->last_a);
    }
    inside_a = mrd_clamp(mrd_is_finite(led_a) ? led_a : s->last_a, 0.0, p->inverse_current_max_a);
    most_a = mrd_most_change_a(mrd_rate_max_a_s(p), dt_s);
    cut_a = mrd_clamp(inside_a, s->last_a - most_a, s->last_a + most_a);
    if (cut_a < inside_a || cut_a > inside_a) {
        out->limited_by = MRD_LIMITED_BY_RATE;
    }
    fluid_a = mrd_after(p, s, cut_a, dt_s);
    expected_n = (fluid_a >= solved.at.current_a && fluid_a <= solved.at.current_a) ? solved.at.force_n : mrd_moment_force(moment, fluid_a);
    out->expected_n = expected_n + 0.0;
    s->last_a = cut_a;
    out->current_a = cut_a;
#if MRD_INVERSE_REMEMBERS
    mrd_learned_feed(&s->learned, cut_a);
#endif
}

/* The command at a displacement. `drive_counts`: the measured current is neither old nor odd. */
static void mrd_command(const mrd_parameters *p, mrd_inverse *s, mrd_moving *moving, int64_t time_ns, bool drive_counts, mrd_output *out) {
    const double infinity = mrd_infinity();
    mrd_model_inputs *in = &moving->in;
    double dt_s = in->dt_s, demand_n = mrd_nan(), driver_a;
    mrd_begin(p, s);
    out->is_commanded = s->is_requested;
    if (!s->is_requested) {
        mrd_without_forces(s, mrd_nan(), out);
        return;
    }
    if (moving->step_s - p->inverse_request_timeout_s > 0.0) {
        mrd_go_safe(p, s, moving->step_s - p->inverse_request_timeout_s);
    }
    if (s->request.is_known && mrd_between_s(s->request.time_ns, time_ns) <= p->inverse_request_timeout_s) {
        demand_n = s->request.force_n;
    }
    if (!drive_counts) {
        in->drive = mrd_nan();
    }
    if (!(dt_s > 0.0 && dt_s < infinity)) {
        dt_s = mrd_nan();
        /* The model's history is not valid after a gap. The driver still has its current. */
        s->chain = (mrd_inverse_chain){ 0 };
    }
    driver_a = mrd_is_finite(in->drive) ? mrd_clamp(in->drive, 0.0, 2.0 * p->inverse_current_max_a) : s->last_a;
    s->fluid_a = mrd_after(p, s, driver_a, dt_s);
    if (mrd_is_finite(in->displacement_m) && mrd_is_finite(in->velocity_m_s)) {
        mrd_moment moment;
        const double modelled_n = mrd_moment_step(&moment, p, &s->chain, in, s->fluid_a);
        if (!mrd_is_nan(demand_n) && !mrd_is_nan(modelled_n)) {
            mrd_track(p, s, in, dt_s, demand_n, &moment, modelled_n, out);
            return;
        }
    }
    mrd_go_safe(p, s, dt_s);
    mrd_without_forces(s, demand_n, out);
}

double mrd_silent_current_a(const mrd_parameters *parameters, const mrd_state *state, int64_t now_ns) {
    mrd_inverse own = state->inverse;
    mrd_begin(parameters, &own);
    if (own.is_requested && state->has_displacement) {
        const double idle_s = mrd_between_s(state->last_ns, now_ns) - parameters->inverse_request_timeout_s;
        if (idle_s > 0.0) {
            mrd_go_safe(parameters, &own, idle_s);
        }
    }
    return own.last_a;
}
