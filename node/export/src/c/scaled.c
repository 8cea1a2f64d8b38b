/* A force with the damper's part multiplied by a factor that is at least zero; the session's offset is not the damper's.
   @needs inputs
   @source */
static double mrd_scaled(double force_n, double offset_n, double factor) {
    return (force_n - offset_n) * (factor < 0.0 ? 0.0 : factor) + offset_n;
}
