/* The last inputs and forces of an autoregressive model, newest first. They are unknown (NaN) after a start.
   @needs bits inputs
   @header */
typedef struct {
    bool begun;
    double force_n[MRD_DEPTH], displacement_m[MRD_DEPTH], velocity_m_s[MRD_DEPTH], drive[MRD_DEPTH];
} mrd_force_state;
/* @source */
static void mrd_shift_in(double *slots, double value) {
    int j;
    for (j = MRD_DEPTH - 1; j > 0; j--) {
        slots[j] = slots[j - 1];
    }
    slots[0] = value;
}

static void mrd_push_inputs(mrd_force_state *s, const mrd_model_inputs *in) {
    int j;
    if (!s->begun) {
        for (j = 0; j < MRD_DEPTH; j++) {
            s->force_n[j] = mrd_nan();
            s->displacement_m[j] = mrd_nan();
            s->velocity_m_s[j] = mrd_nan();
            s->drive[j] = mrd_nan();
        }
        s->begun = true;
    }
    mrd_shift_in(s->displacement_m, in->displacement_m);
    mrd_shift_in(s->velocity_m_s, in->velocity_m_s);
    mrd_shift_in(s->drive, in->drive);
}

static bool mrd_known(const double *slots, int lags) {
    int j;
    for (j = 0; j < lags; j++) {
        if (!mrd_is_finite(slots[j])) {
            return false;
        }
    }
    return true;
}
