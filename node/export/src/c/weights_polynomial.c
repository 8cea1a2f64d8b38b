/* Powers of the drive.
   @needs bits
   @source */
static void mrd_weights(const mrd_parameters *p, double i, double weights[MRD_COPIES]) {
    double power = 1.0;
    int j;
    (void)p;
    for (j = 0; j < MRD_COPIES; j++) {
        weights[j] = power;
        power *= i;
    }
}
