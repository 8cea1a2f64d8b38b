/* Recursive lazy learning: a local regression on the nearest points of the memory, with the number of points that has the least
   leave-one-out error.
   @needs inputs infinity
   @header */
typedef struct {
    char unused; /* the model has no memory from sample to sample */
} mrd_force_state;
/* @source */
static double mrd_dot(const double *a, const double *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
}

/* The force at the origin of the rows. */
static double mrd_regression(const double rows[MRD_MOST_NEIGHBOURS][4], const double *forces) {
    double v[4][4], b[4] = { 0.0, 0.0, 0.0, 0.0 }, residuals[MRD_MOST_NEIGHBOURS], left_out[MRD_MOST_NEIGHBOURS];
    const double base = forces[0];
    double best = mrd_infinity(), found = 0.0;
    int i, j, k;
    for (i = 0; i < 4; i++) {
        for (j = 0; j < 4; j++) {
            v[i][j] = i == j ? 1e4 : 0.0;
        }
    }
    for (k = 0; k < MRD_MOST_NEIGHBOURS; k++) {
        const double *z = rows[k];
        double vz[4], share, innovation;
        for (i = 0; i < 4; i++) {
            vz[i] = mrd_dot(v[i], z);
        }
        share = 1.0 / (1.0 + mrd_dot(vz, z));
        innovation = forces[k] - base - mrd_dot(b, z);
        for (i = 0; i < 4; i++) {
            b[i] += vz[i] * share * innovation;
            for (j = 0; j < 4; j++) {
                v[i][j] -= vz[i] * vz[j] * share;
            }
        }
        for (j = 0; j < k; j++) {
            const double common = mrd_dot(vz, rows[j]);
            residuals[j] -= common * share * innovation;
            left_out[j] += common * common * share;
        }
        residuals[k] = innovation * share;
        left_out[k] = share;
        if (k + 1 >= MRD_LEAST_NEIGHBOURS) {
            double squares = -0.0, press;
            for (j = 0; j <= k; j++) {
                const double error = residuals[j] / left_out[j];
                squares += error * error;
            }
            press = squares / (double)(k + 1);
            if (press < best) {
                best = press;
                found = b[0];
            }
        }
    }
    return base + found;
}

static double mrd_force(const mrd_parameters *p, mrd_force_state *s, const mrd_model_inputs *in) {
    double squares[MRD_MOST_NEIGHBOURS], rows[MRD_MOST_NEIGHBOURS][4], forces[MRD_MOST_NEIGHBOURS];
    int nearest[MRD_MOST_NEIGHBOURS], j, k;
    const double x = in->displacement_m, v = in->velocity_m_s;
    const double scale_x = p->displacement_scale_m, scale_v = p->velocity_scale_m_s;
#if MRD_HAS_DRIVE
    const double drive = in->drive, scale_i = p->@drive_scale@;
    const double *drives = p->@memory_drive@;
#endif
    (void)s;
#if MRD_HAS_DRIVE
    if (!mrd_is_finite(drive)) {
        return mrd_nan();
    }
#endif
    if (!(mrd_is_finite(x) && mrd_is_finite(v))) {
        return mrd_nan();
    }
    for (k = 0; k < MRD_MOST_NEIGHBOURS; k++) {
        squares[k] = mrd_infinity();
        nearest[k] = 0;
    }
    for (j = 0; j < MRD_POINTS; j++) {
        const double dx = (p->memory_displacement_m[j] - x) * (1.0 / scale_x);
        const double dv = (p->memory_velocity_m_s[j] - v) * (1.0 / scale_v);
#if MRD_HAS_DRIVE
        const double di = (drives[j] - drive) * (1.0 / scale_i);
#else
        const double di = 0.0;
#endif
        const double square = dx * dx + dv * dv + di * di;
        if (square < squares[MRD_MOST_NEIGHBOURS - 1]) {
            k = MRD_MOST_NEIGHBOURS - 1;
            while (k > 0 && square < squares[k - 1]) {
                squares[k] = squares[k - 1];
                nearest[k] = nearest[k - 1];
                k--;
            }
            squares[k] = square;
            nearest[k] = j;
        }
    }
    for (k = 0; k < MRD_MOST_NEIGHBOURS; k++) {
        j = nearest[k];
        rows[k][0] = 1.0;
        rows[k][1] = (p->memory_displacement_m[j] - x) / scale_x;
        rows[k][2] = (p->memory_velocity_m_s[j] - v) / scale_v;
#if MRD_HAS_DRIVE
        rows[k][3] = (drives[j] - drive) / scale_i;
#else
        rows[k][3] = 0.0;
#endif
        forces[k] = p->memory_force_n[j];
    }
    return p->force_offset_n + mrd_regression((const double (*)[4])rows, forces);
}
