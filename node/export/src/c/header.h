@PREFACE@
#ifndef MRD_H
#define MRD_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

@SIZES@
/* Reasons why an estimate is not as good as it could be: bits of mrd_output.flags. They have the values of the service. */
#define MRD_DRIVE_MISSING UINT32_C(1)         /* no drive yet: no force */
#define MRD_DRIVE_STALE UINT32_C(2)           /* the last drive is older than input_timeout_s */
#define MRD_DISPLACEMENT_GAP UINT32_C(8)      /* the displacement before is older than gap_s, or was at another place */
#define MRD_INPUT_REFUSED UINT32_C(16)        /* a reading since the last estimate was refused */
#define MRD_OUTSIDE_ENVELOPE UINT32_C(32)     /* the model extrapolates beyond its training data */
#define MRD_SETTLING UINT32_C(512)            /* the filters have not settled yet */
#define MRD_TEMPERATURE_MISSING UINT32_C(8192) /* no case temperature yet */
#define MRD_INPUT_RANGE UINT32_C(16384)       /* a refused reading was beyond what its sensor can have */
#define MRD_INPUT_RATE UINT32_C(32768)        /* a refused displacement would have needed too high a speed */

#if MRD_HAS_INVERSE
/* Why a command does not reach the demanded force: values of mrd_output.limited_by. */
#define MRD_LIMITED_BY_NONE UINT32_C(0)
#define MRD_LIMITED_BY_CURRENT_MAX UINT32_C(1) /* the damper is too soft at its largest current */
#define MRD_LIMITED_BY_CURRENT_MIN UINT32_C(2) /* the damper is too hard even without current */
#define MRD_LIMITED_BY_RATE UINT32_C(3)        /* the largest rate of the current */
#define MRD_LIMITED_BY_PASSIVITY UINT32_C(4)   /* the force would drive the rod */
#define MRD_LIMITED_BY_SAFE UINT32_C(5)        /* no demand, or the motion is not known: the current goes to the safe current */

#endif
/* Everything that calibration may change. A change takes effect with the next sample. */
typedef struct {
@PARAMETERS@} mrd_parameters;

/* The values of the model file. */
extern const mrd_parameters mrd_default_parameters;

@TYPES@
#if MRD_HAS_HELD
typedef struct {
    mrd_gate gate;
    bool is_known;
    int64_t time_ns;
    double value;
} mrd_held;
#endif

typedef struct {
    bool has_last;
    uint32_t other_count;
    int64_t last_ns, other_ns;
    double last_m, other_m;
} mrd_place;

#if MRD_APPLY_TO_OUTPUT
typedef struct {
    bool is_running;
    mrd_low_pass low_pass;
} mrd_output_filter;

#endif
typedef struct {
    double settled_s, velocity_m_s;
    bool has_velocity;
#if MRD_APPLY_TO_INPUTS
    mrd_low_pass low_pass;
#endif
#if MRD_HAS_DERIVATIVE
    mrd_derivative derivative;
#endif
} mrd_motion;

/* The model with its effects. */
typedef struct {
    mrd_force_state force;
@EFFECT_STATES@} mrd_chain;

#if MRD_HAS_INVERSE
@INVERSE_TYPES@
#endif

/* State of one damper. All zeros is its state at rest, so static memory needs no call of mrd_reset. */
typedef struct {
    mrd_gate displacement;
    mrd_place place;
#if MRD_HAS_DRIVE
    mrd_held drive;
#endif
#if MRD_VELOCITY_MEASURED
    mrd_held velocity;
#endif
#if MRD_NEEDS_TEMPERATURE
    mrd_held temperature;
#endif
#if MRD_HAS_INVERSE
    bool drive_is_odd;
    mrd_inverse inverse;
#endif
    uint32_t pending;
    bool has_displacement;
    int64_t last_ns;
#if MRD_CORRECTS_STAMPS
    mrd_timing timing;
    int64_t taken_ns;
#endif
    mrd_motion motion;
    mrd_chain damper;
#if MRD_HAS_LOAD_CELL
    mrd_chain reading;
#endif
#if MRD_APPLY_TO_OUTPUT
    mrd_output_filter damper_filter;
#if MRD_HAS_LOAD_CELL
    mrd_output_filter reading_filter;
#endif
#endif
} mrd_state;

/* Readings of one sample. */
typedef struct {
    int64_t time_ns;       /* of the readings, on any clock that increases, ns */
    double displacement_m; /* positive in extension, m */
#if MRD_HAS_DRIVE
    double @DRIVE@;      /* @DRIVE_ABOUT@; NaN if there is no new reading: the last one is held */
#endif
#if MRD_VELOCITY_MEASURED
    double velocity_m_s;   /* measured, positive in extension, m/s; NaN if there is no new reading */
#endif
#if MRD_NEEDS_TEMPERATURE
    double case_temp_c;    /* of the damper's case, degrees Celsius; NaN if there is no new reading */
#endif
#if MRD_HAS_INVERSE
    double force_request_n; /* demanded force, N; NaN if there is no new request: the last one is held */
#endif
} mrd_input;

/* The estimate of one sample. */
typedef struct {
    double force_n;        /* of the damper, positive in extension, N; NaN if there is none */
    double reading_n;      /* that the load cell should show, N: with the effects of the load cell */
    double displacement_m; /* that the model was given, m */
    double velocity_m_s;   /* that the model was given, m/s */
#if MRD_HAS_INVERSE
    double current_a;      /* commanded, A; always finite, between 0 and the largest */
    double requested_n;    /* demanded force, N; NaN if there is none */
    double expected_n;     /* force that the model expects at this current, N; NaN if there is none */
    double achievable_n[2]; /* least and largest force of the damper at this motion, N; NaN if not known */
#endif
    uint32_t flags;        /* reasons, see above; 0 for a good estimate */
#if MRD_HAS_INVERSE
    uint32_t limited_by;   /* why the command does not reach the demanded force, see above */
    bool is_commanded;     /* false before the first request, and if the displacement was refused: current_a is the one before */
    bool is_achievable;    /* the demanded force is dissipative, and within the achievable range */
    bool is_dissipative;   /* the demanded force takes energy out of the motion */
#if MRD_INVERSE_LEARNED
    bool is_substituted;   /* the search gave the current, because the learned inverse gave none */
#endif
#endif
} mrd_output;

/* Puts the damper at rest: the next sample is the first. */
void mrd_reset(mrd_state *state);

/* One sample. Returns false if the displacement was refused: then there is no estimate, and the time until the next sample counts on.
   Never allocates, never waits, and takes a bounded number of operations. */
bool mrd_step(const mrd_parameters *parameters, mrd_state *state, const mrd_input *input, mrd_output *output);

#if MRD_HAS_INVERSE
/* The current at `now_ns` while no displacement arrives: after inverse_request_timeout_s it goes to the safe current. Changes nothing. */
double mrd_silent_current_a(const mrd_parameters *parameters, const mrd_state *state, int64_t now_ns);

#endif

#ifdef __cplusplus
}
#endif

#endif
