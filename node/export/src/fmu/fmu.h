/* @NAME@_fmu.h: what the FMI functions of all versions share: variables, states, the order of calls, messages, and one step. */
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
#if MRD_HAS_INVERSE
#define MRD_FMU_REQUEST 5U
#endif
#define MRD_FMU_FORCE 11U
#define MRD_FMU_READING 12U
#define MRD_FMU_USED_DISPLACEMENT 13U
#define MRD_FMU_USED_VELOCITY 14U
#define MRD_FMU_FLAGS 15U
#define MRD_FMU_VALID 16U
#define MRD_FMU_ACCEPTED 17U
#if MRD_HAS_INVERSE
#define MRD_FMU_CURRENT 21U
#define MRD_FMU_REQUESTED 22U
#define MRD_FMU_EXPECTED 23U
#if MRD_HAS_ARRAYS
#define MRD_FMU_ACHIEVABLE 24U
#else
#define MRD_FMU_LEAST 24U
#define MRD_FMU_MOST 25U
#endif
#define MRD_FMU_LIMITED_BY 26U
#define MRD_FMU_IS_COMMANDED 27U
#define MRD_FMU_IS_ACHIEVABLE 28U
#define MRD_FMU_IS_DISSIPATIVE 29U
#if MRD_INVERSE_LEARNED
#define MRD_FMU_IS_SUBSTITUTED 30U
#endif
#endif
#define MRD_FMU_FIRST_PARAMETER 1000U

/* Number of values in mrd_parameters. */
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

/* Where the messages of an instance go: `send` calls the importer's logger. */
typedef struct {
    bool is_on;
    void (*send)(const void *importer, const char *message);
    const void *importer; /* what `send` needs */
} mrd_fmu_logger;

/* What the instances of all versions begin with. */
typedef struct {
    mrd_fmu_logger logger;
    mrd_fmu fmu;
} mrd_fmu_instance;

/* The functions below that return bool do what the function of the standard called `function` does. They return false after they have
   logged what is wrong. */

/* Logs what is wrong. */
void mrd_fmu_fail(const mrd_fmu_logger *to, const char *function, const char *what);
void mrd_fmu_fail_at(const mrd_fmu_logger *to, const char *function, uint32_t reference, const char *what);

/* True without a fault. */
bool mrd_fmu_has_done(const mrd_fmu_logger *to, const char *function, const char *fault);

/* Messages have the categories logStatusError and, in FMI 2.0, logAll. No category means all. */
void mrd_fmu_set_logging(mrd_fmu_logger *of, bool is_on, const char *const categories[], size_t count);

/* As after instantiation: start values, and the damper at rest. */
void mrd_fmu_reset(mrd_fmu *fmu);

/* From one mode to the next. Return NULL, or what is wrong. */
const char *mrd_fmu_enter_initialization(mrd_fmu *fmu, double start_s);
const char *mrd_fmu_exit_initialization(mrd_fmu *fmu);
const char *mrd_fmu_terminate(mrd_fmu *fmu);

/* One sample, whose readings are the inputs and whose time is `time_s`. Returns NULL, or what is wrong. */
const char *mrd_fmu_step(mrd_fmu *fmu, double time_s, double step_s);

/* The numbers of floating-point variables, of which `references` has `variables`: the elements of the first, then those of the next. */
bool mrd_fmu_get_numbers(mrd_fmu_instance *of, const char *function, const uint32_t references[], size_t variables, double values[],
                         size_t count);
bool mrd_fmu_set_numbers(mrd_fmu_instance *of, const char *function, const uint32_t references[], size_t variables,
                         const double values[], size_t count);

/* A variable that is an integer, and one that is true or false. */
bool mrd_fmu_get_word(const mrd_fmu_instance *of, const char *function, uint32_t reference, uint32_t *value);
bool mrd_fmu_get_truth(const mrd_fmu_instance *of, const char *function, uint32_t reference, bool *value);

/* Copies of the state, and their bytes. */
bool mrd_fmu_get_state(const mrd_fmu_instance *of, const char *function, void **state);
bool mrd_fmu_set_state(mrd_fmu_instance *of, const char *function, const void *state);
void mrd_fmu_free_state(void **state);
size_t mrd_fmu_stored_size(void);
bool mrd_fmu_store(const mrd_fmu_instance *of, const char *function, const void *state, void *bytes, size_t size);
bool mrd_fmu_restore(const mrd_fmu_instance *of, const char *function, const void *bytes, size_t size, void **state);

/* The file of a version defines MRD_FMI(name), a function's whole name, and MRD_IS_STATIC if the functions are linked statically. */
#define MRD_JOIN(a, b) a##b
#define MRD_JOIN_BOTH(a, b) MRD_JOIN(a, b)
#if defined(MRD_IS_STATIC)
#define MRD_EXPORT
#elif defined(_WIN32) || defined(__CYGWIN__)
#define MRD_EXPORT __declspec(dllexport)
#elif defined(__GNUC__)
#define MRD_EXPORT __attribute__((visibility("default")))
#else
#define MRD_EXPORT
#endif

/* A function that importers call: declared before it is defined. */
#define MRD_FUNCTION(type, name, ...)                                                                                            \
    MRD_EXPORT type MRD_FMI(name)(__VA_ARGS__);                                                                                  \
    MRD_EXPORT type MRD_FMI(name)(__VA_ARGS__)

#ifdef __cplusplus
}
#endif

#endif
