/* @NAME@_fmi2.c: the functions of FMI 2.0 (Functional Mock-up Interface, Modelica Association) for co-simulation.
   Functions for what this FMU has not (strings, derivatives, steps that run beside the caller) return an error and say why. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "@NAME@_fmu.h"

/* Types of the standard, as far as they are needed: section 2.1 of FMI 2.0. */
typedef void *fmi2Component;
typedef void *fmi2ComponentEnvironment;
typedef void *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef const char *fmi2String;
typedef char fmi2Byte;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;
typedef struct {
    void (*logger)(fmi2ComponentEnvironment, fmi2String instanceName, fmi2Status, fmi2String category, fmi2String message, ...);
    void *(*allocateMemory)(size_t count, size_t size);
    void (*freeMemory)(void *memory);
    void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;

/* With FMI2_FUNCTION_PREFIX the functions have names of their own, so that they can be linked statically. */
#ifdef FMI2_FUNCTION_PREFIX
#define MRD_JOIN(a, b) a##b
#define MRD_JOIN_BOTH(a, b) MRD_JOIN(a, b)
#define MRD_FMI2(name) MRD_JOIN_BOTH(FMI2_FUNCTION_PREFIX, fmi2##name)
#define MRD_EXPORT
#else
#define MRD_FMI2(name) fmi2##name
#if defined(_WIN32) || defined(__CYGWIN__)
#define MRD_EXPORT __declspec(dllexport)
#elif defined(__GNUC__)
#define MRD_EXPORT __attribute__((visibility("default")))
#else
#define MRD_EXPORT
#endif
#endif

/* A function that importers call: declared before it is defined. */
#define MRD_FUNCTION(type, name, ...)                                                                                            \
    MRD_EXPORT type MRD_FMI2(name)(__VA_ARGS__);                                                                                 \
    MRD_EXPORT type MRD_FMI2(name)(__VA_ARGS__)

/* One instance. */
typedef struct {
    bool logging_on;
    char *name;
    const fmi2CallbackFunctions *callbacks;
    mrd_fmu fmu;
} mrd_instance;

static void mrd_say(const fmi2CallbackFunctions *callbacks, fmi2String name, const char *message) {
    if (callbacks != NULL && callbacks->logger != NULL) {
        callbacks->logger(callbacks->componentEnvironment, name, fmi2Error, "logStatusError", message);
    }
}

static fmi2Status mrd_fail(const mrd_instance *of, const char *function, const char *what) {
    if (of->logging_on) {
        char message[512];
        (void)snprintf(message, sizeof message, "%s: %s.", function, what);
        mrd_say(of->callbacks, of->name, message);
    }
    return fmi2Error;
}

/* fmi2OK without a fault. */
static fmi2Status mrd_status(const mrd_instance *of, const char *function, const char *fault) {
    return fault == NULL ? fmi2OK : mrd_fail(of, function, fault);
}

static fmi2Status mrd_fail_at(const mrd_instance *of, const char *function, fmi2ValueReference reference, const char *what) {
    char message[256];
    (void)snprintf(message, sizeof message, "value reference %lu: %s", (unsigned long)reference, what);
    return mrd_fail(of, function, message);
}

MRD_FUNCTION(const char *, GetTypesPlatform, void) {
    return "default";
}

MRD_FUNCTION(const char *, GetVersion, void) {
    return "2.0";
}

MRD_FUNCTION(fmi2Status, SetDebugLogging, fmi2Component c, fmi2Boolean loggingOn, size_t nCategories,
             const fmi2String categories[]) {
    mrd_instance *of = (mrd_instance *)c;
    size_t k;
    bool is_ours = nCategories == 0U;
    for (k = 0U; k < nCategories; k++) {
        is_ours = is_ours || strcmp(categories[k], "logStatusError") == 0 || strcmp(categories[k], "logAll") == 0;
    }
    of->logging_on = loggingOn != 0 && is_ours;
    return fmi2OK;
}

MRD_FUNCTION(fmi2Component, Instantiate, fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID,
             fmi2String fmuResourceLocation, const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean loggingOn) {
    mrd_instance *of;
    size_t length;
    (void)fmuResourceLocation;
    (void)visible;
    if (instanceName == NULL) {
        instanceName = "";
    }
    if (fmuType != fmi2CoSimulation || fmuGUID == NULL || strcmp(fmuGUID, MRD_FMU_TOKEN) != 0) {
        mrd_say(functions, instanceName, "fmi2Instantiate: this FMU is for co-simulation, or the GUID is not that of this FMU.");
        return NULL;
    }
    length = strlen(instanceName) + 1U;
    of = (mrd_instance *)calloc(1U, sizeof *of);
    if (of != NULL) {
        of->name = (char *)malloc(length);
    }
    if (of == NULL || of->name == NULL) {
        free(of);
        mrd_say(functions, instanceName, "fmi2Instantiate: there is no memory.");
        return NULL;
    }
    memcpy(of->name, instanceName, length);
    of->callbacks = functions;
    of->logging_on = loggingOn != 0;
    mrd_fmu_reset(&of->fmu);
    return of;
}

MRD_FUNCTION(void, FreeInstance, fmi2Component c) {
    mrd_instance *of = (mrd_instance *)c;
    if (of != NULL) {
        free(of->name);
        free(of);
    }
}

MRD_FUNCTION(fmi2Status, SetupExperiment, fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance, fmi2Real startTime,
             fmi2Boolean stopTimeDefined, fmi2Real stopTime) {
    mrd_instance *of = (mrd_instance *)c;
    (void)toleranceDefined;
    (void)tolerance;
    (void)stopTimeDefined;
    (void)stopTime;
    if (of->fmu.mode != MRD_FMU_INSTANTIATED) {
        return mrd_fail(of, "fmi2SetupExperiment", "the experiment is set up before initialization");
    }
    of->fmu.time_s = startTime;
    return fmi2OK;
}

MRD_FUNCTION(fmi2Status, EnterInitializationMode, fmi2Component c) {
    mrd_instance *of = (mrd_instance *)c;
    return mrd_status(of, "fmi2EnterInitializationMode", mrd_fmu_enter_initialization(&of->fmu, of->fmu.time_s));
}

MRD_FUNCTION(fmi2Status, ExitInitializationMode, fmi2Component c) {
    mrd_instance *of = (mrd_instance *)c;
    return mrd_status(of, "fmi2ExitInitializationMode", mrd_fmu_exit_initialization(&of->fmu));
}

MRD_FUNCTION(fmi2Status, Terminate, fmi2Component c) {
    mrd_instance *of = (mrd_instance *)c;
    return mrd_status(of, "fmi2Terminate", mrd_fmu_terminate(&of->fmu));
}

MRD_FUNCTION(fmi2Status, Reset, fmi2Component c) {
    mrd_fmu_reset(&((mrd_instance *)c)->fmu);
    return fmi2OK;
}

MRD_FUNCTION(fmi2Status, DoStep, fmi2Component c, fmi2Real currentCommunicationPoint, fmi2Real communicationStepSize,
             fmi2Boolean noSetFMUStatePriorToCurrentPoint) {
    mrd_instance *of = (mrd_instance *)c;
    (void)noSetFMUStatePriorToCurrentPoint;
    return mrd_status(of, "fmi2DoStep", mrd_fmu_step(&of->fmu, currentCommunicationPoint, communicationStepSize));
}

MRD_FUNCTION(fmi2Status, GetReal, fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Real value[]) {
    mrd_instance *of = (mrd_instance *)c;
    size_t k, count;
    for (k = 0U; k < nvr; k++) {
        const double *numbers = mrd_fmu_numbers(&of->fmu, vr[k], &count);
        if (numbers == NULL) {
            return mrd_fail_at(of, "fmi2GetReal", vr[k], "there is no such variable of type Real");
        }
        value[k] = *numbers;
    }
    return fmi2OK;
}

MRD_FUNCTION(fmi2Status, SetReal, fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Real value[]) {
    mrd_instance *of = (mrd_instance *)c;
    size_t k;
    for (k = 0U; k < nvr; k++) {
        const char *fault = mrd_fmu_set(&of->fmu, vr[k], 0U, value[k]);
        if (fault != NULL) {
            return mrd_fail_at(of, "fmi2SetReal", vr[k], fault);
        }
    }
    return fmi2OK;
}

MRD_FUNCTION(fmi2Status, GetInteger, fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Integer value[]) {
    mrd_instance *of = (mrd_instance *)c;
    size_t k;
    for (k = 0U; k < nvr; k++) {
        if (vr[k] != MRD_FMU_FLAGS) {
            return mrd_fail_at(of, "fmi2GetInteger", vr[k], "there is no such variable of type Integer");
        }
        value[k] = (fmi2Integer)of->fmu.output.flags;
    }
    return fmi2OK;
}

MRD_FUNCTION(fmi2Status, GetBoolean, fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Boolean value[]) {
    mrd_instance *of = (mrd_instance *)c;
    size_t k;
    for (k = 0U; k < nvr; k++) {
        if (vr[k] == MRD_FMU_VALID) {
            value[k] = mrd_fmu_is_valid(&of->fmu) ? 1 : 0;
        } else if (vr[k] == MRD_FMU_ACCEPTED) {
            value[k] = of->fmu.accepted ? 1 : 0;
        } else {
            return mrd_fail_at(of, "fmi2GetBoolean", vr[k], "there is no such variable of type Boolean");
        }
    }
    return fmi2OK;
}

MRD_FUNCTION(fmi2Status, GetFMUstate, fmi2Component c, fmi2FMUstate *FMUstate) {
    mrd_instance *of = (mrd_instance *)c;
    if (*FMUstate == NULL) {
        *FMUstate = malloc(sizeof(mrd_fmu));
    }
    if (*FMUstate == NULL) {
        return mrd_fail(of, "fmi2GetFMUstate", "there is no memory");
    }
    memcpy(*FMUstate, &of->fmu, sizeof of->fmu);
    return fmi2OK;
}

MRD_FUNCTION(fmi2Status, SetFMUstate, fmi2Component c, fmi2FMUstate FMUstate) {
    mrd_instance *of = (mrd_instance *)c;
    if (FMUstate == NULL) {
        return mrd_fail(of, "fmi2SetFMUstate", "there is no state");
    }
    memcpy(&of->fmu, FMUstate, sizeof of->fmu);
    return fmi2OK;
}

MRD_FUNCTION(fmi2Status, FreeFMUstate, fmi2Component c, fmi2FMUstate *FMUstate) {
    (void)c;
    if (FMUstate != NULL) {
        free(*FMUstate);
        *FMUstate = NULL;
    }
    return fmi2OK;
}

MRD_FUNCTION(fmi2Status, SerializedFMUstateSize, fmi2Component c, fmi2FMUstate FMUstate, size_t *size) {
    (void)c;
    (void)FMUstate;
    *size = mrd_fmu_stored_size();
    return fmi2OK;
}

MRD_FUNCTION(fmi2Status, SerializeFMUstate, fmi2Component c, fmi2FMUstate FMUstate, fmi2Byte serializedState[], size_t size) {
    mrd_instance *of = (mrd_instance *)c;
    if (FMUstate == NULL || size < mrd_fmu_stored_size()) {
        return mrd_fail(of, "fmi2SerializeFMUstate", "there is no state, or the buffer is too short for it");
    }
    mrd_fmu_store((const mrd_fmu *)FMUstate, (unsigned char *)serializedState);
    return fmi2OK;
}

MRD_FUNCTION(fmi2Status, DeSerializeFMUstate, fmi2Component c, const fmi2Byte serializedState[], size_t size,
             fmi2FMUstate *FMUstate) {
    mrd_instance *of = (mrd_instance *)c;
    mrd_fmu *own = (mrd_fmu *)malloc(sizeof *own);
    const char *fault =
        own == NULL ? "there is no memory" : mrd_fmu_restore(own, (const unsigned char *)serializedState, size);
    if (fault != NULL) {
        free(own);
        return mrd_fail(of, "fmi2DeSerializeFMUstate", fault);
    }
    free(*FMUstate);
    *FMUstate = own;
    return fmi2OK;
}

MRD_FUNCTION(fmi2Status, GetStatus, fmi2Component c, const fmi2StatusKind s, fmi2Status *value) {
    (void)value;
    (void)s;
    (void)mrd_fail((const mrd_instance *)c, "fmi2GetStatus", "no step of this FMU runs beside the caller");
    return fmi2Discard;
}

MRD_FUNCTION(fmi2Status, GetRealStatus, fmi2Component c, const fmi2StatusKind s, fmi2Real *value) {
    const mrd_instance *of = (const mrd_instance *)c;
    if (s == fmi2LastSuccessfulTime) {
        *value = of->fmu.time_s;
        return fmi2OK;
    }
    (void)mrd_fail(of, "fmi2GetRealStatus", "this status is not a time");
    return fmi2Discard;
}

MRD_FUNCTION(fmi2Status, GetIntegerStatus, fmi2Component c, const fmi2StatusKind s, fmi2Integer *value) {
    (void)value;
    (void)s;
    (void)mrd_fail((const mrd_instance *)c, "fmi2GetIntegerStatus", "there is no such status");
    return fmi2Discard;
}

MRD_FUNCTION(fmi2Status, GetBooleanStatus, fmi2Component c, const fmi2StatusKind s, fmi2Boolean *value) {
    const mrd_instance *of = (const mrd_instance *)c;
    if (s == fmi2Terminated) {
        *value = 0;
        return fmi2OK;
    }
    (void)mrd_fail(of, "fmi2GetBooleanStatus", "this status is not a Boolean");
    return fmi2Discard;
}

MRD_FUNCTION(fmi2Status, GetStringStatus, fmi2Component c, const fmi2StatusKind s, fmi2String *value) {
    (void)value;
    (void)s;
    (void)mrd_fail((const mrd_instance *)c, "fmi2GetStringStatus", "no step of this FMU runs beside the caller");
    return fmi2Discard;
}

/* Not supported, for which `why` is the reason. */
#define MRD_REFUSES(why, name, ...)                                                                                              \
    MRD_FUNCTION(fmi2Status, name, __VA_ARGS__) {                                                                                \
        return mrd_fail((const mrd_instance *)c, "fmi2" #name, why);                                                             \
    }

/* Arguments that are not used. */
#define MRD_WHICH fmi2Component c, const fmi2ValueReference vr[], size_t nvr

#if defined(__GNUC__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

MRD_REFUSES("flags are an output", SetInteger, MRD_WHICH, const fmi2Integer value[])
MRD_REFUSES("all variables of type Boolean are outputs", SetBoolean, MRD_WHICH, const fmi2Boolean value[])
MRD_REFUSES("this FMU has no variable of this type", GetString, MRD_WHICH, fmi2String value[])
MRD_REFUSES("this FMU has no variable of this type", SetString, MRD_WHICH, const fmi2String value[])
MRD_REFUSES("this FMU gives no derivatives", GetDirectionalDerivative, fmi2Component c, const fmi2ValueReference vUnknown_ref[],
            size_t nUnknown, const fmi2ValueReference vKnown_ref[], size_t nKnown, const fmi2Real dvKnown[], fmi2Real dvUnknown[])
MRD_REFUSES("this FMU does not interpolate its inputs", SetRealInputDerivatives, MRD_WHICH, const fmi2Integer order[],
            const fmi2Real value[])
MRD_REFUSES("this FMU gives no derivatives", GetRealOutputDerivatives, MRD_WHICH, const fmi2Integer order[], fmi2Real value[])
MRD_REFUSES("no step of this FMU runs beside the caller", CancelStep, fmi2Component c)

#if defined(__GNUC__)
#pragma GCC diagnostic pop
#endif
