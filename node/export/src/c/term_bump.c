/* A bump, exp(-z^2).
   @needs exp
   @source */
static double mrd_term_bump(double z) {
    return mrd_exp(-(z * z));
}
