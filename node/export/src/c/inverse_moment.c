/* The damper's force at one motion, for any current: the model without the lag of its coil, from its state before the sample.
   @needs finite inputs
   @source */
typedef struct {
    const mrd_parameters *p;
    const mrd_model_inputs *in;
    mrd_inverse_chain before;
} mrd_moment;

/* Steps the chain at this current. Returns the force, N; NaN if it is not finite. */
static double mrd_moment_step(mrd_moment *m, const mrd_parameters *p, mrd_inverse_chain *chain, const mrd_model_inputs *in,
                              double current_a) {
    mrd_model_inputs own = *in;
    m->p = p;
    m->in = in;
    m->before = *chain;
    own.drive = current_a;
    return mrd_finite(mrd_run_@INVERSE@(p, chain, &own));
}

static double mrd_moment_force(const mrd_moment *m, double current_a) {
    mrd_inverse_chain chain = m->before;
    mrd_model_inputs own = *m->in;
    own.drive = current_a;
    return mrd_finite(mrd_run_@INVERSE@(m->p, &chain, &own));
}

#if MRD_INVERSE_ADDS
/* Force that the effects add at this moment, N; NaN if the model has no force. */
static double mrd_moment_added(const mrd_moment *m) {
#if MRD_INVERSE_BARE
    (void)m;
    return 0.0;
#else
    mrd_force_state alone = m->before.force;
    mrd_model_inputs own = *m->in;
    own.drive = 0.0;
    return mrd_finite(mrd_moment_force(m, 0.0) - mrd_force(m->p, &alone, &own));
#endif
}
#endif
