/* Signals that terms are functions of: time, path, energy, reversals and changes of the drive since the start.
   @needs exp_m1 sign inputs resonator_state running_sum
   @header */
typedef struct {
    bool begun, extrapolates;
    mrd_running_sum time_s, path_m, energy_j;
    double step_s, first_temp_c;
    double furthest_m, furthest_s, turn_m, turn_s, direction;
    double held_drive, changed_s, lagged_drive, mean_speed_m_s, force_n;
    mrd_resonator filters[3];
} mrd_terms_state;
/* @source */
static void mrd_signals_begin(mrd_terms_state *s, const mrd_model_inputs *in) {
    s->begun = true;
    mrd_running_sum_begin(&s->time_s);
    s->step_s = 0.0;
    mrd_running_sum_begin(&s->path_m);
    mrd_running_sum_begin(&s->energy_j);
    s->first_temp_c = in->case_temp_c;
    s->furthest_m = in->displacement_m;
    s->furthest_s = 0.0;
    s->turn_m = in->displacement_m;
    s->turn_s = 0.0;
    s->direction = 0.0;
    s->held_drive = in->drive;
    s->changed_s = 0.0;
    s->lagged_drive = in->drive;
    s->mean_speed_m_s = 0.0;
    s->force_n = 0.0;
}

/* A reversal counts when the displacement has come back by 0.1 mm. */
static void mrd_follow_turns(mrd_terms_state *s, double displacement_m) {
    const double onward_m = (displacement_m - s->furthest_m) * s->direction;
    if (s->direction >= 0.0 && s->direction <= 0.0) {
        const double moved_m = displacement_m - s->furthest_m;
        if (mrd_abs(moved_m) > 1e-4) {
            s->direction = mrd_signum(moved_m);
            s->furthest_m = displacement_m;
            s->furthest_s = s->time_s.sum;
        }
    } else if (onward_m >= 0.0) {
        s->furthest_m = displacement_m;
        s->furthest_s = s->time_s.sum;
    } else if (onward_m < -1e-4) {
        s->turn_m = s->furthest_m;
        s->turn_s = s->furthest_s;
        s->direction = -s->direction;
        s->furthest_m = displacement_m;
        s->furthest_s = s->time_s.sum;
    }
}

static void mrd_signals_before_force(mrd_terms_state *s, const mrd_model_inputs *in) {
    const double speed_m_s = mrd_abs(in->velocity_m_s);
    if (!(s->begun && in->dt_s > 0.0)) {
        mrd_signals_begin(s, in);
        return;
    }
    mrd_running_sum_add(&s->time_s, in->dt_s);
    s->step_s = in->dt_s;
    if (mrd_is_finite(speed_m_s)) {
        mrd_running_sum_add(&s->path_m, speed_m_s * in->dt_s);
        s->mean_speed_m_s = s->mean_speed_m_s + (speed_m_s - s->mean_speed_m_s) * -mrd_exp_m1(-in->dt_s / 1.0);
    }
    mrd_follow_turns(s, in->displacement_m);
    if (mrd_is_finite(in->drive)) {
        const double share = -mrd_exp_m1(-in->dt_s / 0.05);
        if (mrd_abs(in->drive - s->held_drive) > 0.05 || !mrd_is_finite(s->held_drive)) {
            s->held_drive = in->drive;
            s->changed_s = s->time_s.sum;
        }
        s->lagged_drive = mrd_is_finite(s->lagged_drive) ? s->lagged_drive + (in->drive - s->lagged_drive) * share : in->drive;
    }
    if (!mrd_is_finite(s->first_temp_c)) {
        s->first_temp_c = in->case_temp_c;
    }
}

/* `force_n`: of the damper, without the session's offset. */
static void mrd_signals_after_force(mrd_terms_state *s, const mrd_model_inputs *in, double force_n) {
    mrd_running_sum_add(&s->energy_j, s->force_n * in->velocity_m_s * s->step_s);
    s->force_n = force_n;
}
