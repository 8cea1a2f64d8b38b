/* One sample: checks of the readings, conditioning, simulation, flags.
   @needs gate bits max inputs
   @source */
/* Readings beyond this are no current, A, or voltage, V, of a damper driver. */
#define MRD_DRIVE_MAX 1e3
/* Possible case temperatures of a damper, degrees Celsius. */
#define MRD_TEMP_MIN_C -100.0
#define MRD_TEMP_MAX_C 400.0
/* Largest force that is accepted from the model, N. */
#define MRD_FORCE_MAX_N 1e9

/* True if the rod can have come from `from_m` to `x_m`. */
static bool mrd_comes_from(const mrd_parameters *p, int64_t from_ns, double from_m, int64_t time_ns, double x_m) {
    const double way_m = mrd_abs(x_m - from_m);
    return way_m <= p->speed_max_m_s * mrd_max(mrd_between_s(from_ns, time_ns), 2e-3);
}

/* Refuses a displacement that the rod cannot have reached, until three in a row agree. Returns MRD_TIME_JUMPED for such a new place. */
static int mrd_place_check(const mrd_parameters *p, mrd_place *s, int64_t time_ns, double x_m) {
    int decision = MRD_ACCEPT;
    if (s->has_last && !mrd_comes_from(p, s->last_ns, s->last_m, time_ns, x_m)) {
        const bool follows = s->other_count > 0U && mrd_comes_from(p, s->other_ns, s->other_m, time_ns, x_m);
        s->other_count = follows ? s->other_count + 1U : 1U;
        s->other_ns = time_ns;
        s->other_m = x_m;
        if (s->other_count < 3U) {
            return MRD_REFUSE;
        }
        decision = MRD_TIME_JUMPED;
    }
    s->has_last = true;
    s->last_ns = time_ns;
    s->last_m = x_m;
    s->other_count = 0U;
    return decision;
}

#if MRD_HAS_HELD
/* Takes a reading of a channel that is held between readings; returns MRD_REFUSE if it did not. */
static int mrd_hold(mrd_held *h, uint32_t *pending, int64_t time_ns, double value, double low, double high) {
    int decision;
    if (mrd_is_nan(value)) {
        return MRD_REFUSE; /* no reading */
    }
    if (!mrd_is_finite(value)) {
        *pending |= MRD_INPUT_REFUSED;
        return MRD_REFUSE;
    }
    if (value < low || value > high) {
        *pending |= MRD_INPUT_REFUSED | MRD_INPUT_RANGE;
        return MRD_REFUSE;
    }
    decision = mrd_gate_check(&h->gate, time_ns);
    if (decision == MRD_REFUSE) {
        *pending |= MRD_INPUT_REFUSED;
        return MRD_REFUSE;
    }
    h->is_known = true;
    h->time_ns = time_ns;
    h->value = value;
    return decision;
}
#endif

#if MRD_HAS_RANGES
/* True beyond a range by more than 5 % of its width. */
static bool mrd_leaves(const double range[2], double value) {
    const double slack = 0.05 * (range[1] - range[0]);
    return value < range[0] - slack || value > range[1] + slack;
}
#endif

static double mrd_accepted(double force_n) {
    return mrd_abs(force_n) <= MRD_FORCE_MAX_N ? force_n : mrd_nan();
}

#if MRD_APPLY_TO_OUTPUT
/* Low-pass of a force. */
static double mrd_filtered(const mrd_parameters *p, mrd_output_filter *f, double dt_s, double force_n) {
    const double step_s = f->is_running ? dt_s : mrd_nan();
    f->is_running = true;
    return mrd_low_pass_step(&f->low_pass, p->cutoff_hz, step_s, force_n);
}
#endif

void mrd_reset(mrd_state *s) {
    *s = (mrd_state){ 0 };
}

/* Motion from the displacement; returns false without a velocity. */
static bool mrd_condition(const mrd_parameters *p, mrd_motion *s, mrd_model_inputs *in, double displacement_m,
                          double velocity_m_s, uint32_t *flags) {
    double before_m_s;
    const bool is_first = mrd_is_nan(in->dt_s);
#if MRD_SETTLES
    double settling_s = 0.0;
#endif
#if MRD_FILTERS
    settling_s = 6.64 * mrd_tau_s(p->cutoff_hz);
#endif
#if MRD_VELOCITY_SLOPE
    settling_s += p->slope_window_s;
#endif
    s->settled_s = is_first ? 0.0 : s->settled_s + in->dt_s;
#if MRD_SETTLES
    if (is_first || s->settled_s < settling_s) {
        *flags |= MRD_SETTLING;
    }
#else
    if (is_first) {
        *flags |= MRD_SETTLING;
    }
#endif
#if MRD_APPLY_TO_INPUTS
    in->displacement_m = mrd_low_pass_step(&s->low_pass, p->cutoff_hz, in->dt_s, displacement_m);
#else
    in->displacement_m = displacement_m;
#endif
#if MRD_VELOCITY_MEASURED
    (void)p;
    in->velocity_m_s = velocity_m_s;
#else
    (void)velocity_m_s;
    in->velocity_m_s = mrd_derivative_step(&s->derivative, p, in->dt_s, in->displacement_m);
#endif
    before_m_s = s->has_velocity ? s->velocity_m_s : mrd_nan();
    s->velocity_m_s = in->velocity_m_s;
    s->has_velocity = !mrd_is_nan(in->velocity_m_s);
    in->acceleration_m_s2 = is_first ? mrd_nan() : (in->velocity_m_s - before_m_s) / in->dt_s;
    return s->has_velocity;
}

/* Force of the damper, N, and expected reading of the load cell, N. */
static void mrd_simulate(const mrd_parameters *p, mrd_state *s, const mrd_model_inputs *in, mrd_output *out) {
    double force_n = mrd_accepted(mrd_run_@DAMPER@(p, &s->damper, in));
#if MRD_HAS_LOAD_CELL
    double reading_n = mrd_accepted(mrd_run_@READING@(p, &s->reading, in));
#endif
#if MRD_HAS_TERMS
    if (mrd_terms_extrapolate(&s->damper)) {
        out->flags |= MRD_OUTSIDE_ENVELOPE;
    }
#endif
#if MRD_HAS_FORCE_RANGE
    if (mrd_leaves(p->force_range_n, force_n)) {
        out->flags |= MRD_OUTSIDE_ENVELOPE;
    }
#endif
#if MRD_APPLY_TO_OUTPUT
    if (!mrd_is_nan(force_n)) {
        force_n = mrd_filtered(p, &s->damper_filter, in->dt_s, force_n);
#if MRD_HAS_FORCE_RANGE
        if (mrd_leaves(p->force_range_n, force_n)) {
            out->flags |= MRD_OUTSIDE_ENVELOPE;
        }
#endif
    }
#if MRD_HAS_LOAD_CELL
    if (!mrd_is_nan(reading_n)) {
        reading_n = mrd_filtered(p, &s->reading_filter, in->dt_s, reading_n);
    }
#endif
#endif
    out->force_n = force_n;
#if MRD_HAS_LOAD_CELL
    out->reading_n = reading_n;
#else
    out->reading_n = force_n;
#endif
}

#if MRD_HAS_INVERSE
/* The estimate, and the sample for the inverse controller. */
static bool mrd_estimate(const mrd_parameters *p, mrd_state *s, const mrd_input *input, mrd_output *out, mrd_moving *moving) {
#else
bool mrd_step(const mrd_parameters *p, mrd_state *s, const mrd_input *input, mrd_output *out) {
#endif
    const double x_m = input->displacement_m;
    mrd_model_inputs in;
    double step_s, velocity_m_s;
    int decision;
    bool has_motion;
#if MRD_CORRECTS_STAMPS
    int64_t taken_ns;
#endif
#if MRD_HAS_INVERSE
    const mrd_held before = s->drive;
#endif

    out->force_n = mrd_nan();
    out->reading_n = mrd_nan();
    out->displacement_m = mrd_nan();
    out->velocity_m_s = mrd_nan();
    out->flags = MRD_INPUT_REFUSED;

#if MRD_HAS_INVERSE
    decision = mrd_hold(&s->drive, &s->pending, input->time_ns, input->@DRIVE@, -MRD_DRIVE_MAX, MRD_DRIVE_MAX);
    if (decision != MRD_REFUSE) {
        s->drive_is_odd = mrd_current_is_odd(p, s->drive_is_odd, before.is_known && decision == MRD_ACCEPT,
                                             mrd_between_s(before.time_ns, input->time_ns), before.value, input->@DRIVE@);
    }
#else
#if MRD_HAS_DRIVE
    (void)mrd_hold(&s->drive, &s->pending, input->time_ns, input->@DRIVE@, -MRD_DRIVE_MAX, MRD_DRIVE_MAX);
#endif
#endif
#if MRD_VELOCITY_MEASURED
    (void)mrd_hold(&s->velocity, &s->pending, input->time_ns, input->velocity_m_s, -p->speed_max_m_s, p->speed_max_m_s);
#endif
#if MRD_NEEDS_TEMPERATURE
    (void)mrd_hold(&s->temperature, &s->pending, input->time_ns, input->case_temp_c, MRD_TEMP_MIN_C, MRD_TEMP_MAX_C);
#endif

    if (!mrd_is_finite(x_m)) {
        s->pending |= MRD_INPUT_REFUSED;
        return false;
    }
    if (mrd_abs(x_m) > p->displacement_max_m) {
        s->pending |= MRD_INPUT_REFUSED | MRD_INPUT_RANGE;
        out->flags |= MRD_INPUT_RANGE;
        return false;
    }
    decision = mrd_gate_check(&s->displacement, input->time_ns);
    if (decision == MRD_REFUSE) {
        s->pending |= MRD_INPUT_REFUSED;
        return false;
    }
    if (decision == MRD_TIME_JUMPED) {
        /* All readings before belong to another time. */
        const uint32_t pending = s->pending;
        const mrd_gate gate = s->displacement;
#if MRD_HAS_INVERSE
        /* The driver keeps its current; the request belongs to another time, too. */
        const mrd_inverse inverse = s->inverse;
        mrd_reset(s);
        s->inverse = inverse;
        s->inverse.request = (mrd_request){ 0 };
#else
        mrd_reset(s);
#endif
        s->pending = pending;
        s->displacement = gate;
    }
    decision = mrd_place_check(p, &s->place, input->time_ns, x_m);
    if (decision == MRD_REFUSE) {
        s->pending |= MRD_INPUT_REFUSED | MRD_INPUT_RATE;
        out->flags |= MRD_INPUT_RATE;
        return false;
    }
    if (decision == MRD_TIME_JUMPED) {
        s->has_displacement = false;
        s->pending |= MRD_DISPLACEMENT_GAP;
    }

    out->flags = s->pending;
    s->pending = 0U;
    step_s = s->has_displacement ? mrd_between_s(s->last_ns, input->time_ns) : mrd_nan();
#if MRD_CORRECTS_STAMPS
    if (!(step_s <= p->gap_s)) {
        s->timing = (mrd_timing){ 0 }; /* a step over a gap says nothing about the period */
    }
    taken_ns = mrd_timing_place(&s->timing, input->time_ns, x_m);
    in.dt_s = s->has_displacement ? mrd_between_s(s->taken_ns, taken_ns) : mrd_nan();
    s->taken_ns = taken_ns;
    if (step_s > p->gap_s) {
        out->flags |= MRD_DISPLACEMENT_GAP;
    }
    if (in.dt_s > p->gap_s) {
        in.dt_s = mrd_nan();
    }
#else
    in.dt_s = step_s;
    if (step_s > p->gap_s) {
        out->flags |= MRD_DISPLACEMENT_GAP;
        in.dt_s = mrd_nan();
    }
#endif
    s->has_displacement = true;
    s->last_ns = input->time_ns;

    in.drive = mrd_nan();
#if MRD_HAS_DRIVE
    if (s->drive.is_known) {
        in.drive = s->drive.value;
        if (mrd_between_s(s->drive.time_ns, input->time_ns) > p->input_timeout_s) {
            out->flags |= MRD_DRIVE_STALE;
        }
    }
#endif
    velocity_m_s = mrd_nan();
#if MRD_VELOCITY_MEASURED
    if (s->velocity.is_known && mrd_between_s(s->velocity.time_ns, input->time_ns) <= p->gap_s) {
        velocity_m_s = s->velocity.value;
    }
#endif
    in.case_temp_c = mrd_nan();
#if MRD_NEEDS_TEMPERATURE
    if (s->temperature.is_known) {
        in.case_temp_c = s->temperature.value;
    }
#endif

    if (mrd_is_nan(in.dt_s)) {
        s->motion = (mrd_motion){ 0 };
        s->damper = (mrd_chain){ 0 };
#if MRD_HAS_LOAD_CELL
        s->reading = (mrd_chain){ 0 };
#endif
#if MRD_APPLY_TO_OUTPUT
        s->damper_filter.is_running = false;
#if MRD_HAS_LOAD_CELL
        s->reading_filter.is_running = false;
#endif
#endif
    }
    has_motion = mrd_condition(p, &s->motion, &in, x_m, velocity_m_s, &out->flags);
#if MRD_HAS_INVERSE
    moving->in = in;
    moving->step_s = step_s;
    if (!has_motion) {
        moving->in.dt_s = mrd_nan();
        moving->in.displacement_m = mrd_nan();
        moving->in.velocity_m_s = mrd_nan();
        moving->in.acceleration_m_s2 = mrd_nan();
        moving->in.drive = mrd_nan();
        moving->in.case_temp_c = mrd_nan();
    }
#endif
#if MRD_HAS_DRIVE
    if (mrd_is_nan(in.drive)) {
        out->flags |= MRD_DRIVE_MISSING;
        return true;
    }
#endif
#if MRD_NEEDS_TEMPERATURE
    if (mrd_is_nan(in.case_temp_c)) {
        out->flags |= MRD_TEMPERATURE_MISSING;
    }
#endif
    if (!has_motion) {
        return true;
    }
    out->displacement_m = in.displacement_m;
    out->velocity_m_s = in.velocity_m_s;
#if MRD_HAS_DISPLACEMENT_RANGE
    if (mrd_leaves(p->displacement_range_m, in.displacement_m)) {
        out->flags |= MRD_OUTSIDE_ENVELOPE;
    }
#endif
#if MRD_HAS_VELOCITY_RANGE
    if (mrd_leaves(p->velocity_range_m_s, in.velocity_m_s)) {
        out->flags |= MRD_OUTSIDE_ENVELOPE;
    }
#endif
#if MRD_HAS_DRIVE_RANGE
    if (mrd_leaves(p->@drive_range@, in.drive)) {
        out->flags |= MRD_OUTSIDE_ENVELOPE;
    }
#endif
#if MRD_HAS_TEMPERATURE_RANGE
    if (mrd_leaves(p->case_temp_range_c, in.case_temp_c)) {
        out->flags |= MRD_OUTSIDE_ENVELOPE;
    }
#endif
    mrd_simulate(p, s, &in, out);
    return true;
}

#if MRD_HAS_INVERSE
bool mrd_step(const mrd_parameters *p, mrd_state *s, const mrd_input *input, mrd_output *out) {
    mrd_moving moving;
    bool drive_counts;
    mrd_take_request(p, &s->inverse.request, &s->inverse.is_requested, input->time_ns, input->force_request_n);
    if (!mrd_estimate(p, s, input, out, &moving)) {
        /* No command: the one before holds. */
        mrd_begin(p, &s->inverse);
        out->is_commanded = false;
        mrd_without_forces(&s->inverse, mrd_nan(), out);
        return false;
    }
    drive_counts = (out->flags & MRD_DRIVE_STALE) == 0U && !s->drive_is_odd;
    mrd_command(p, &s->inverse, &moving, input->time_ns, drive_counts, out);
    return true;
}
#endif
