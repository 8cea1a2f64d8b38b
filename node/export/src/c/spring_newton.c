/* Newton steps of a series spring around a model without memory that gives its slope. A short step is the last.
   @needs effect_series_spring force_slope clamp
   @source */
static bool mrd_newton_step(mrd_newton *w, double offset_n, double model_n, double growth) {
    const double slope = 1.0 - growth;
    const double step_n = (model_n - w->at_n) / slope;
    double length_n, size_n;
    if (!(slope > 0.0 && mrd_is_finite(step_n))) {
        return false;
    }
    w->slope = slope;
    w->force_n = w->force_n + step_n * w->unsure;
    w->at_n = w->at_n + step_n;
    length_n = mrd_abs(step_n);
    size_n = mrd_abs(w->at_n - offset_n) + 1.0;
    if (length_n <= 1e-2 * size_n) {
        w->unsure = 0.0;
    } else {
        const double way = mrd_clamp((length_n / size_n - 1e-2) / (2e-2 - 1e-2), 0.0, 1.0);
        w->unsure *= way * way * (3.0 - 2.0 * way);
    }
    return true;
}

static void mrd_newton_search(const mrd_parameters *p, const mrd_spring *a, mrd_newton *w, const mrd_model_inputs *in) {
    mrd_along_drive at;
    int k;
    if (!a->has_before) {
        return;
    }
    at.all = mrd_strengths(p, in->drive, at.strengths);
    for (k = 0; k < 3; k++) {
        const mrd_model_inputs piston = mrd_behind(a, in, w->at_n);
        double model_n, growth;
        mrd_force_and_slope(p, &at, &piston, -a->compliance_m_n, -a->compliance_m_n * a->per_s, &model_n, &growth);
        if (!mrd_newton_step(w, a->offset_n, model_n, growth) || w->unsure <= 0.0) {
            break;
        }
    }
}
