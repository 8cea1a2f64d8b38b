/* Play operator: the output stays while the input is within half a width of it.
   @needs max min
   @source */
static double mrd_play(double before, double input, double half_width) {
    return mrd_min(mrd_max(before, input - half_width), input + half_width);
}
