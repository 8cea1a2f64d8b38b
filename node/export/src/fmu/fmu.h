/* @NAME@_fmu.h: what the FMI functions of all versions share: variables, state, and one step. */
#ifndef MRD_FMU_H
#define MRD_FMU_H

#include <stddef.h>

#include "@NAME@.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Identifies this FMU; the model description has the same. */
#define MRD_FMU_TOKEN "@TOKEN@"

/* Value references. Parameters follow from MRD_FMU_FIRST_PARAMETER on. */
#define MRD_FMU_TIME 0U
#define MRD_FMU_DISPLACEMENT 1U
#define MRD_FMU_DRIVE 2U
#define MRD_FMU_VELOCITY 3U
#define MRD_FMU_TEMPERATURE 4U
#define MRD_FMU_FORCE 11U
#define MRD_FMU_READING 12U
#define MRD_FMU_USED_DISPLACEMENT 13U
#define MRD_FMU_USED_VELOCITY 14U
#define MRD_FMU_FLAGS 15U
#define MRD_FMU_VALID 16U
#define MRD_FMU_ACCEPTED 17U
#define MRD_FMU_FIRST_PARAMETER 1000U

/* Numbers of mrd_parameters. */
#define MRD_FMU_NUMBERS @NUMBERS@

typedef enum {
    MRD_FMU_INSTANTIATED,
    MRD_FMU_INITIALIZING,
    MRD_FMU_STEPPING,
    MRD_FMU_TERMINATED
} mrd_fmu_mode;

/* The parameters by name, and as numbers in the same order: all fields are double. */
typedef union {
    mrd_parameters named;
    double numbers[MRD_FMU_NUMBERS];
} mrd_fmu_parameters;

/* Everything that an FMU state keeps. */
typedef struct {
    mrd_fmu_mode mode;
    double time_s; /* that the simulation has reached, s */
    bool has_stepped;
    bool accepted;
    mrd_input input;
    mrd_output output;
    mrd_fmu_parameters parameters;
    mrd_state damper;
} mrd_fmu;

/* As after instantiation: start values, and the damper at rest. */
void mrd_fmu_reset(mrd_fmu *fmu);

/* True if there is an estimate. */
bool mrd_fmu_is_valid(const mrd_fmu *fmu);

/* The numbers of a floating-point variable, and how many; NULL if there is none with this reference. */
double *mrd_fmu_numbers(mrd_fmu *fmu, uint32_t reference, size_t *count);

/* Sets one number of an input or a parameter. Returns NULL, or what is wrong. */
const char *mrd_fmu_set(mrd_fmu *fmu, uint32_t reference, size_t element, double value);

/* From one mode to the next, or what is wrong. */
const char *mrd_fmu_enter_initialization(mrd_fmu *fmu, double start_s);
const char *mrd_fmu_exit_initialization(mrd_fmu *fmu);
const char *mrd_fmu_terminate(mrd_fmu *fmu);

/* One sample, whose readings are the inputs and whose time is `time_s`. Returns NULL, or what is wrong. */
const char *mrd_fmu_step(mrd_fmu *fmu, double time_s, double step_s);

/* Bytes of a stored state. */
size_t mrd_fmu_stored_size(void);
void mrd_fmu_store(const mrd_fmu *fmu, unsigned char *bytes);
/* Returns NULL, or what is wrong. */
const char *mrd_fmu_restore(mrd_fmu *fmu, const unsigned char *bytes, size_t size);

#ifdef __cplusplus
}
#endif

#endif
