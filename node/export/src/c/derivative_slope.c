/* Velocity by the least-squares slope over a window, v_k = sum (t - mean t)(x - mean x)/sum (t - mean t)^2.
   @needs bits
   @header */
typedef struct {
    double time_s;
    uint32_t length, next;
    double times_s[64], values[64];
} mrd_derivative;
/* @source */
static void mrd_derivative_push(mrd_derivative *s, double value) {
    s->times_s[s->next] = s->time_s;
    s->values[s->next] = value;
    s->next = (s->next + 1U) % 64U;
    if (s->length < 64U) {
        s->length += 1U;
    }
}

static double mrd_derivative_step(mrd_derivative *s, const mrd_parameters *p, double dt_s, double value) {
    double n = 0.0, st = 0.0, sx = 0.0, stt = 0.0, stx = 0.0, t0, x0;
    uint32_t age;
    if (mrd_is_nan(dt_s)) {
        s->length = 0U;
        s->next = 0U;
        s->time_s = 0.0;
        mrd_derivative_push(s, value);
        return mrd_nan();
    }
    s->time_s += dt_s;
    mrd_derivative_push(s, value);
    t0 = s->times_s[(s->next + 63U) % 64U];
    x0 = s->values[(s->next + 63U) % 64U];
    for (age = 0U; age < s->length; age++) {
        const uint32_t slot = (s->next + 63U - age) % 64U;
        const double t = s->times_s[slot] - t0, x = s->values[slot] - x0;
        if (age > 1U && -t > p->slope_window_s + 1e-9) {
            break;
        }
        n += 1.0;
        st += t;
        sx += x;
        stt += t * t;
        stx += t * x;
    }
    return (n * stx - st * sx) / (n * stt - st * st);
}
