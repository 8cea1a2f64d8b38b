/* Time between the samples that an effect can use. Samples in between count towards the time.
   @needs bits
   @header */
typedef struct {
    bool begun;
    double waited_s;
} mrd_elapsed;
/* @source */
/* Time since the last valid sample, s; NaN at the first one and after a gap. */
static double mrd_since_s(const mrd_elapsed *e, double dt_s) {
    return (e->begun && dt_s > 0.0) ? e->waited_s + dt_s : mrd_nan();
}

/* Records a valid sample. */
static double mrd_hit(mrd_elapsed *e, double dt_s) {
    const double since_s = mrd_since_s(e, dt_s);
    e->begun = true;
    e->waited_s = 0.0;
    return since_s;
}
