/* Bouc-Wen with a dashpot in series (Spencer et al. 1997):
   f = c1 y' + k1 x,   (c0 + c1) y' = alpha z + k0 (x - y) + c0 v,
   z' = -gamma |x' - y'| z |z|^(n-1) - beta (x' - y') |z|^n + A (x' - y')
   Integrated by ROS2 (Verwer et al. 1999) in steps of at most 0.5 ms, at most 8.
   @needs exp ln inputs infinity
   @source */
typedef struct {
    double c1, k0, k1, alpha, gamma, n, beta, a;
    double mobility; /* 1/(c0 + c1) */
    double bound;    /* of |z| */
} mrd_bouc_wen;

static double mrd_slip(const mrd_bouc_wen *d, double r, double z, double v) {
    return (d->c1 * v - d->alpha * z - d->k0 * r) * d->mobility;
}

/* |z|^(n-1); beta + gamma or beta - gamma in `shape`. */
static double mrd_shape(const mrd_bouc_wen *d, double slip, double z, double *shape) {
    double magnitude;
    bool loading;
    if (z > 0.0) {
        magnitude = z;
        loading = slip >= 0.0;
    } else if (z < 0.0) {
        magnitude = -z;
        loading = slip < 0.0;
    } else {
        *shape = d->beta;
        return 0.0;
    }
    *shape = loading ? d->beta + d->gamma : d->beta - d->gamma;
    return mrd_exp((d->n - 1.0) * mrd_ln(magnitude));
}

static double mrd_bounded(const mrd_bouc_wen *d, double z, double before) {
    const double limit = before > d->bound ? before : d->bound;
    if (z > limit) {
        return limit;
    }
    return z < -limit ? -limit : z;
}

static double mrd_size(double z) {
    return z < 0.0 ? -z : z;
}

static void mrd_advance(const mrd_bouc_wen *d, double *r, double *z, double v0, double v1, double h) {
    double shape, power, slip, magnitude, growth, slip_by_r, slip_by_z, bend, dh, decay, least, rate_by_z;
    double w11, w12, w21, w22, inverse, k1r, k1z, k2z, r2, z2, rate, a, b;
    slip = mrd_slip(d, *r, *z, v0);
    power = mrd_shape(d, slip, *z, &shape);
    magnitude = mrd_size(*z);
    growth = d->a - shape * power * magnitude;
    slip_by_r = -(d->k0 * d->mobility);
    slip_by_z = -(d->alpha * d->mobility);
    bend = shape * d->n * power * slip;
    dh = (1.0 - 0.7071067811865476) * h;
    decay = *z < 0.0 ? -bend : bend;
    least = -0.5 / dh;
    decay = decay > least ? decay : least;
    rate_by_z = growth * slip_by_z - decay;
    w11 = 1.0 - slip_by_r * dh;
    w12 = -(slip_by_z * dh);
    w21 = -(growth * slip_by_r * dh);
    w22 = 1.0 - rate_by_z * dh;
    inverse = 1.0 / (w11 * w22 - w12 * w21);
    b = slip * growth;
    k1r = (w22 * slip - w12 * b) * inverse;
    k1z = (w11 * b - w21 * slip) * inverse;
    r2 = *r + k1r * h;
    z2 = mrd_bounded(d, *z + k1z * h, magnitude);
    slip = mrd_slip(d, r2, z2, v1);
    power = mrd_shape(d, slip, z2, &shape);
    rate = slip * (d->a - shape * power * mrd_size(z2));
    a = slip - k1r * 2.0;
    b = rate - k1z * 2.0;
    k2z = (w11 * b - w21 * a) * inverse;
    *r = *r + (k1r * 3.0 + (w22 * a - w12 * b) * inverse) * (0.5 * h);
    *z = mrd_bounded(d, *z + (k1z * 3.0 + k2z) * (0.5 * h), magnitude);
}

/* hidden: r = x - y, z, and the velocity of the sample before */
static double mrd_law(const double *p, const mrd_model_inputs *in, double *hidden) {
    const double x = in->displacement_m, v = in->velocity_m_s;
    double bound, r = 0.0, z = 0.0;
    mrd_bouc_wen d;
    if (!(mrd_is_finite(x) && mrd_is_finite(v))) {
        return mrd_nan();
    }
    d.mobility = 1.0 / (p[0] + p[1]);
    bound = p[8] / (p[5] + p[7]);
    d.c1 = p[1];
    d.k0 = p[2];
    d.k1 = p[3];
    d.alpha = p[4];
    d.gamma = p[5];
    d.n = p[6];
    d.beta = p[7];
    d.a = p[8];
    d.bound = bound > 0.0 ? mrd_exp(mrd_ln(bound) / p[6]) : mrd_infinity();
    if (!mrd_is_nan(in->dt_s)) {
        const double quotient = in->dt_s / 0.5e-3;
        int steps = 1, k;
        double h, slope;
        while (steps < 8 && (double)steps < quotient) {
            steps++;
        }
        r = hidden[0];
        z = hidden[1];
        h = in->dt_s / (double)steps;
        slope = (v - hidden[2]) * (1.0 / (double)steps);
        for (k = 0; k < steps; k++) {
            const double start = hidden[2] + slope * (double)k;
            mrd_advance(&d, &r, &z, start, start + slope, h);
        }
    }
    hidden[0] = r;
    hidden[1] = z;
    hidden[2] = v;
    return d.c1 * (v - mrd_slip(&d, r, z, v)) + d.k1 * x;
}
