/* Records a sample that an effect cannot use.
   @needs elapsed
   @source */
static void mrd_miss(mrd_elapsed *e, double dt_s) {
    const double waited_s = mrd_since_s(e, dt_s);
    e->begun = !mrd_is_nan(waited_s);
    e->waited_s = e->begun ? waited_s : 0.0;
}
