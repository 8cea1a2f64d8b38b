/* A smooth step, (tanh z + 1)/2.
   @needs tanh
   @source */
static double mrd_term_step(double z) {
    return (mrd_tanh(z) + 1.0) * 0.5;
}
