/* Smooth sign of a velocity, tanh(v / 5 mm/s).
   @needs tanh
   @source */
static double mrd_smooth_sign(double velocity_m_s) {
    return mrd_tanh(velocity_m_s / 5e-3);
}
