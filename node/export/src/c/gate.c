/* Refuses readings whose time does not increase, until several in a row come from another time. Then the clock has been set.
   @needs bits
   @header */
typedef struct {
    bool has_last;
    uint32_t other_count;
    int64_t last_ns, other_ns;
} mrd_gate;
/* @source */
#define MRD_ACCEPT 0
#define MRD_REFUSE 1
#define MRD_TIME_JUMPED 2

/* Seconds from `earlier_ns` to `later_ns`. */
static double mrd_between_s(int64_t earlier_ns, int64_t later_ns) {
    return (double)(int64_t)((uint64_t)later_ns - (uint64_t)earlier_ns) * 1e-9;
}

static int mrd_gate_check(mrd_gate *g, int64_t time_ns) {
    int decision = MRD_ACCEPT;
    if (g->has_last && time_ns == g->last_ns) {
        return MRD_REFUSE;
    }
    if (g->has_last && time_ns < g->last_ns) {
        const uint32_t after = mrd_between_s(time_ns, g->last_ns) <= 0.5 ? 20U : 3U;
        const bool follows = g->other_count > 0U && time_ns > g->other_ns;
        g->other_count = follows ? g->other_count + 1U : 1U;
        g->other_ns = time_ns;
        if (g->other_count < after) {
            return MRD_REFUSE;
        }
        decision = MRD_TIME_JUMPED;
    }
    g->has_last = true;
    g->last_ns = time_ns;
    g->other_count = 0U;
    return decision;
}
