/* Velocity by the least-squares slope over a window, v_k = sum (t - mean t)(x - mean x)/sum (t - mean t)^2. Times are differences, which
   stay exact however long the unit runs.
   @needs bits
   @header */
typedef struct {
    uint32_t length, next;
    float steps_s[64], values[64]; /* time since the value before, and the value */
} mrd_derivative;
/* @source */
static void mrd_derivative_push(mrd_derivative *s, float step_s, float value) {
    s->steps_s[s->next] = step_s;
    s->values[s->next] = value;
    s->next = (s->next + 1U) % 64U;
    if (s->length < 64U) {
        s->length += 1U;
    }
}

static float mrd_derivative_step(mrd_derivative *s, const mrd_parameters *p, float dt_s, float value) {
    float n = 0.0f, st = 0.0f, sx = 0.0f, stt = 0.0f, stx = 0.0f, t = 0.0f;
    uint32_t age;
    if (mrd_is_nan(dt_s)) {
        s->length = 0U;
        s->next = 0U;
        mrd_derivative_push(s, 0.0f, value);
        return mrd_nan();
    }
    mrd_derivative_push(s, dt_s, value);
    for (age = 0U; age < s->length; age++) {
        const uint32_t slot = (s->next + 63U - age) % 64U;
        const float x = s->values[slot] - value;
        if (age > 0U) {
            t -= s->steps_s[(slot + 1U) % 64U];
        }
        if (age > 1U && -t > p->slope_window_s + 1e-6f) {
            break;
        }
        n += 1.0f;
        st += t;
        sx += x;
        stt += t * t;
        stx += t * x;
    }
    return (n * stx - st * sx) / (n * stt - st * st);
}
