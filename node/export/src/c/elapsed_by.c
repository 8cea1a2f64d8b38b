/* Records a sample by the drive or force that an effect uses; false if it is not finite, so that the sample cannot be used.
   @needs elapsed_miss
   @source */
static bool mrd_elapsed_by(mrd_elapsed *e, double value, double dt_s, double *since_s) {
    if (!mrd_is_finite(value)) {
        mrd_miss(e, dt_s);
        return false;
    }
    *since_s = mrd_hit(e, dt_s);
    return true;
}
