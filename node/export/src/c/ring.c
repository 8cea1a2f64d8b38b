/* The last values of a signal over at least 10 ms at any rate.
   @needs bits
   @header */
typedef struct {
    double spacing_s[64], value[64]; /* time since the value before, and the value */
    uint32_t newest, length;
} mrd_ring;
/* @source */
static void mrd_ring_restart(mrd_ring *s, double value) {
    s->newest = 0U;
    s->length = 1U;
    s->spacing_s[0] = 0.0;
    s->value[0] = value;
}

static void mrd_ring_push(mrd_ring *s, double since_s, double value) {
    const double spacing_s = s->spacing_s[s->newest];
    if (s->length > 1U && spacing_s < 10e-3 / 62.0) {
        s->spacing_s[s->newest] = spacing_s + since_s;
        s->value[s->newest] = value;
        return;
    }
    s->newest = (s->newest + 1U) % 64U;
    if (s->length < 64U) {
        s->length += 1U;
    }
    s->spacing_s[s->newest] = since_s;
    s->value[s->newest] = value;
}

static double mrd_ring_at(const mrd_ring *s, double age_s) {
    uint32_t slot = s->newest, k;
    double left_s = age_s;
    for (k = 1U; k < s->length; k++) {
        const uint32_t before = (slot + 63U) % 64U;
        if (left_s <= s->spacing_s[slot]) {
            return s->value[slot] + (s->value[before] - s->value[slot]) * (left_s / s->spacing_s[slot]);
        }
        left_s = left_s - s->spacing_s[slot];
        slot = before;
    }
    return s->value[slot];
}
