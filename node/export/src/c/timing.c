/* Sampling times of the displacements where stamps are less accurate than the sampling: a driver samples at even times and stamps late by a
   varying delay. The departures from the parabola through four samples say whether the displacement is smoother over the stamps or over even
   times, which a phase-locked loop follows. Even times are used while they are better.
   @needs gate floor max
   @header */
typedef struct {
    double steps_s[3]; /* the last three, newest first */
    double mean;       /* of the squared departures */
} mrd_roughness;

typedef struct {
    bool has_last, is_even;
    uint32_t seen;
    int64_t stamp_ns, given_ns; /* of the last sample: its stamp, and the time that it was given */
    double offset_s;            /* from the last stamp to its even time */
    double period_s;
    double values[3]; /* the last three, newest first */
    mrd_roughness by_stamp, by_number;
} mrd_timing;
/* @source */
/* Samples that determine the first period, before the loop closes. */
#define MRD_TIMING_FIRST 30U

/* The nearest integer; the one further from zero if both are as near. */
static double mrd_round(double x) {
    const double size = mrd_abs(x);
    double whole = mrd_floor(size);
    if (size - whole >= 0.5) {
        whole += 1.0;
    }
    return x < 0.0 ? -whole : whole;
}

static int64_t mrd_shifted_ns(int64_t time_ns, int64_t by_ns) {
    if (by_ns > 0 && time_ns > INT64_MAX - by_ns) {
        return INT64_MAX;
    }
    if (by_ns < 0 && time_ns < INT64_MIN - by_ns) {
        return INT64_MIN;
    }
    return time_ns + by_ns;
}

/* Adds the departure of the last value but one from the parabola through its neighbours, over steps of which the newest is `step_s`. */
static void mrd_roughness_see(mrd_roughness *r, double step_s, double value, const double values[3], double most_s, uint32_t seen) {
    double cb, ba, az, ca, bz, cz, w_c, w_a, w_z, departure, square;
    r->steps_s[2] = r->steps_s[1];
    r->steps_s[1] = r->steps_s[0];
    r->steps_s[0] = step_s;
    cb = r->steps_s[0];
    ba = r->steps_s[1];
    az = r->steps_s[2];
    if (!(cb > 0.0 && ba > 0.0 && az > 0.0 && cb + ba + az <= most_s)) {
        return;
    }
    ca = cb + ba;
    bz = ba + az;
    cz = cb + ba + az;
    w_c = bz * ba / (cz * ca);
    w_a = bz * cb / (az * ca);
    w_z = -ba * cb / (az * cz);
    departure = values[0] - (w_c * value + w_a * values[1] + w_z * values[2]);
    square = departure * departure / (1.0 + w_c * w_c + w_a * w_a + w_z * w_z);
    if (mrd_is_finite(square)) {
        r->mean += (square - r->mean) / (double)(seen < 100U ? seen : 100U);
    }
}

/* Moves the loop by a step of the stamps; returns its own step. */
static double mrd_timing_follow(mrd_timing *s, double step_s) {
    /* Shares of a departure that correct phase and period: from the least-squares line through all samples, up to 80. */
    const uint32_t count = s->seen - MRD_TIMING_FIRST + 15U;
    const double n = (double)(count < 80U ? count : 80U), fit = n * (n + 1.0);
    const double period_s = s->period_s;
    double departure_s = step_s - s->offset_s - period_s, slipped = 0.0, even_step_s;
    if (mrd_abs(departure_s) > 0.75 * period_s) {
        slipped = mrd_round(departure_s / period_s); /* samples were lost, or were counted as lost by mistake */
    }
    departure_s -= slipped * period_s;
    even_step_s = mrd_max(period_s * (1.0 + slipped) + (4.0 * n - 2.0) / fit * departure_s, 0.1 * period_s);
    s->period_s += 6.0 / fit * departure_s;
    s->offset_s += even_step_s - step_s;
    return even_step_s;
}

/* The time at which the sample with this stamp was taken. */
static int64_t mrd_timing_place(mrd_timing *s, int64_t time_ns, double value) {
    const double step_s = s->has_last ? mrd_between_s(s->stamp_ns, time_ns) : mrd_nan();
    int64_t at_ns = time_ns, least_ns;
    if (!s->has_last || (s->seen >= MRD_TIMING_FIRST && !(step_s > 0.0 && step_s < 20.0 * s->period_s))) {
        *s = (mrd_timing){ 0 };
        s->has_last = true;
        s->stamp_ns = time_ns;
        s->given_ns = time_ns;
        s->values[0] = value;
        s->values[1] = mrd_nan();
        s->values[2] = mrd_nan();
        return time_ns;
    }
    if (s->seen < UINT32_MAX) {
        s->seen += 1U;
    }
    if (s->seen <= MRD_TIMING_FIRST) {
        s->period_s += (step_s - s->period_s) / (double)s->seen;
    } else {
        const uint32_t seen = s->seen - MRD_TIMING_FIRST;
        double even_step_s, most_s;
        even_step_s = mrd_timing_follow(s, step_s);
        most_s = 6.0 * s->period_s;
        mrd_roughness_see(&s->by_stamp, step_s, value, s->values, most_s, seen);
        mrd_roughness_see(&s->by_number, even_step_s, value, s->values, most_s, seen);
        if (s->is_even) {
            s->is_even = s->by_number.mean <= 1.25 * s->by_stamp.mean;
        } else {
            s->is_even = seen > 30U && s->by_number.mean < 0.5 * s->by_stamp.mean;
        }
    }
    s->values[2] = s->values[1];
    s->values[1] = s->values[0];
    s->values[0] = value;
    least_ns = mrd_shifted_ns(s->given_ns, 1);
    if (s->is_even) {
        at_ns = mrd_shifted_ns(time_ns, (int64_t)mrd_round(1e9 * s->offset_s));
    }
    s->stamp_ns = time_ns;
    s->given_ns = at_ns > least_ns ? at_ns : least_ns;
    return s->given_ns;
}
