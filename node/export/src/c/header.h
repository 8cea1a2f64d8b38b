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
    uint32_t pending;
    bool has_displacement;
    int64_t last_ns;
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
} mrd_input;

/* The estimate of one sample. */
typedef struct {
    double force_n;        /* of the damper, positive in extension, N; NaN if there is none */
    double reading_n;      /* that the load cell should show, N: with the effects of the load cell */
    double displacement_m; /* that the model was given, m */
    double velocity_m_s;   /* that the model was given, m/s */
    uint32_t flags;        /* reasons, see above; 0 for a good estimate */
} mrd_output;

/* Puts the damper at rest: the next sample is the first. */
void mrd_reset(mrd_state *state);

/* One sample. Returns false if the displacement was refused: then there is no estimate, and the time until the next sample counts on.
   Never allocates, never waits, and takes a bounded number of operations. */
bool mrd_step(const mrd_parameters *parameters, mrd_state *state, const mrd_input *input, mrd_output *output);

#ifdef __cplusplus
}
#endif

#endif
