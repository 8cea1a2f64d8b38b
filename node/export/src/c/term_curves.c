/* Curves of terms: a smooth step, and a bump.
   @needs tanh
   @source */
static double mrd_term_step(double z) {
    return (mrd_tanh(z) + 1.0) * 0.5;
}
