/* atan x = atan(k/8) + atan t,   t = (x - k/8)/(1 + x k/8),   |t| <= 1/16;   pi/2 - atan(1/x) above 1. Error 1.4 ulp.
   @needs bits
   @source */
/* atan(k/8): a number, and its rounding error. */
static const double mrd_arcs[9][2] = {
    { 0.0, 0.0 },
    { 0.12435499454676144, -3.1253241424539383e-18 },
    { 0.24497866312686414, 1.0698755618734451e-17 },
    { 0.35877067027057225, -2.4623815582638635e-17 },
    { 0.4636476090008061, 2.2698777452961687e-17 },
    { 0.5585993153435624, -5.4556305485916264e-18 },
    { 0.6435011087932844, 1.5834785051444286e-17 },
    { 0.7188299996216245, -2.1478388444456983e-17 },
    { 0.7853981633974483, 3.061616997868383e-17 }
};

static int mrd_nearest_eighth(double y) {
    return (int)(mrd_to_bits(y * 8.0 + 6755399441055744.0) & 15U);
}

static double mrd_odd_terms(double t) {
    const double square = t * t;
    const double fourth = square * square;
    const double tail = (-1.0 / 3.0 + square * (1.0 / 5.0))
        + fourth * ((-1.0 / 7.0 + square * (1.0 / 9.0)) + fourth * (-1.0 / 11.0 + square * (1.0 / 13.0)));
    return t * square * tail;
}

static double mrd_atan(double x) {
    const double size = mrd_abs(x);
    double value = 1.5707963267948966;
    if (mrd_is_nan(x)) {
        return x;
    }
    if (size <= 1.0) {
        const int k = mrd_nearest_eighth(size);
        const double c = (double)k * 0.125;
        const double t = (size - c) / (1.0 + size * c);
        value = mrd_arcs[k][0] + (t + (mrd_odd_terms(t) + mrd_arcs[k][1]));
    } else if (size < 1e18) {
        const int k = mrd_nearest_eighth(1.0 / size);
        const double c = (double)k * 0.125;
        const double t = (1.0 - size * c) / (size + c);
        value = (1.5707963267948966 - mrd_arcs[k][0])
            - ((t + mrd_odd_terms(t)) + (mrd_arcs[k][1] - 6.123233995736766e-17));
    }
    return x < 0.0 ? -value : value;
}
