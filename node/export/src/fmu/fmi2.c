/* @NAME@_fmi2.c: the functions of FMI 2.0 (Functional Mock-up Interface, Modelica Association) for co-simulation.
   Functions for what this FMU has not (strings, derivatives, steps that run beside the caller) return an error and say why. */
#include <stdlib.h>
#include <string.h>

/* With FMI2_FUNCTION_PREFIX the functions have names of their own, so that they can be linked statically. */
#ifdef FMI2_FUNCTION_PREFIX
#define MRD_IS_STATIC
#define MRD_FMI(name) MRD_JOIN_BOTH(FMI2_FUNCTION_PREFIX, fmi2##name)
#else
#define MRD_FMI(name) fmi2##name
#endif

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

/* The importer: where messages go, and the name that it gave the instance. */
typedef struct {
    const fmi2CallbackFunctions *callbacks;
    fmi2String name;
} mrd_importer;

/* One instance. Its pointer is also one to what the versions share. */
typedef struct {
    mrd_fmu_instance shared;
    mrd_importer importer;
    char *name;
} mrd_instance;

static void mrd_send(const void *importer, const char *message) {
    const mrd_importer *to = (const mrd_importer *)importer;
    if (to->callbacks != NULL && to->callbacks->logger != NULL) {
        to->callbacks->logger(to->callbacks->componentEnvironment, to->name, fmi2Error, "logStatusError", message);
    }
}

static fmi2Status mrd_status(bool is_done) {
    return is_done ? fmi2OK : fmi2Error;
}

/* The status of a change of modes or a step. */
static fmi2Status mrd_result(const mrd_fmu_instance *of, const char *function, const char *fault) {
    return mrd_status(mrd_fmu_has_done(&of->logger, function, fault));
}

MRD_FUNCTION(const char *, GetTypesPlatform, void) {
    return "default";
}

MRD_FUNCTION(const char *, GetVersion, void) {
    return "2.0";
}

MRD_FUNCTION(fmi2Status, SetDebugLogging, fmi2Component c, fmi2Boolean loggingOn, size_t nCategories,
             const fmi2String categories[]) {
    mrd_fmu_set_logging(&((mrd_fmu_instance *)c)->logger, loggingOn != 0, categories, nCategories);
    return fmi2OK;
}

MRD_FUNCTION(fmi2Component, Instantiate, fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID,
             fmi2String fmuResourceLocation, const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean loggingOn) {
    const mrd_importer importer = { functions, instanceName == NULL ? "" : instanceName };
    const mrd_fmu_logger logger = { true, mrd_send, &importer };
    const size_t length = strlen(importer.name) + 1U;
    mrd_instance *of;
    (void)fmuResourceLocation;
    (void)visible;
    if (fmuType != fmi2CoSimulation || fmuGUID == NULL || strcmp(fmuGUID, MRD_FMU_TOKEN) != 0) {
        mrd_fmu_fail(&logger, "fmi2Instantiate", "this FMU is for co-simulation, or the GUID is not that of this FMU");
        return NULL;
    }
    of = (mrd_instance *)calloc(1U, sizeof *of);
    if (of != NULL) {
        of->name = (char *)malloc(length);
    }
    if (of == NULL || of->name == NULL) {
        free(of);
        mrd_fmu_fail(&logger, "fmi2Instantiate", "there is no memory");
        return NULL;
    }
    memcpy(of->name, importer.name, length);
    of->importer.callbacks = functions;
    of->importer.name = of->name;
    of->shared.logger.is_on = loggingOn != 0;
    of->shared.logger.send = mrd_send;
    of->shared.logger.importer = &of->importer;
    mrd_fmu_reset(&of->shared.fmu);
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
    mrd_fmu_instance *of = (mrd_fmu_instance *)c;
    (void)toleranceDefined;
    (void)tolerance;
    (void)stopTimeDefined;
    (void)stopTime;
    if (of->fmu.mode != MRD_FMU_INSTANTIATED) {
        return mrd_result(of, "fmi2SetupExperiment", "the experiment is set up before initialization");
    }
    of->fmu.time_s = startTime;
    return fmi2OK;
}

MRD_FUNCTION(fmi2Status, EnterInitializationMode, fmi2Component c) {
    mrd_fmu_instance *of = (mrd_fmu_instance *)c;
    return mrd_result(of, "fmi2EnterInitializationMode", mrd_fmu_enter_initialization(&of->fmu, of->fmu.time_s));
}

MRD_FUNCTION(fmi2Status, ExitInitializationMode, fmi2Component c) {
    mrd_fmu_instance *of = (mrd_fmu_instance *)c;
    return mrd_result(of, "fmi2ExitInitializationMode", mrd_fmu_exit_initialization(&of->fmu));
}

MRD_FUNCTION(fmi2Status, Terminate, fmi2Component c) {
    mrd_fmu_instance *of = (mrd_fmu_instance *)c;
    return mrd_result(of, "fmi2Terminate", mrd_fmu_terminate(&of->fmu));
}

MRD_FUNCTION(fmi2Status, Reset, fmi2Component c) {
    mrd_fmu_reset(&((mrd_fmu_instance *)c)->fmu);
    return fmi2OK;
}

MRD_FUNCTION(fmi2Status, DoStep, fmi2Component c, fmi2Real currentCommunicationPoint, fmi2Real communicationStepSize,
             fmi2Boolean noSetFMUStatePriorToCurrentPoint) {
    mrd_fmu_instance *of = (mrd_fmu_instance *)c;
    (void)noSetFMUStatePriorToCurrentPoint;
    return mrd_result(of, "fmi2DoStep", mrd_fmu_step(&of->fmu, currentCommunicationPoint, communicationStepSize));
}

MRD_FUNCTION(fmi2Status, GetReal, fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Real value[]) {
    return mrd_status(mrd_fmu_get_numbers((mrd_fmu_instance *)c, "fmi2GetReal", vr, nvr, value, nvr));
}

MRD_FUNCTION(fmi2Status, SetReal, fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Real value[]) {
    return mrd_status(mrd_fmu_set_numbers((mrd_fmu_instance *)c, "fmi2SetReal", vr, nvr, value, nvr));
}

MRD_FUNCTION(fmi2Status, GetInteger, fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Integer value[]) {
    size_t k;
    uint32_t word;
    for (k = 0U; k < nvr; k++) {
        if (!mrd_fmu_get_word((mrd_fmu_instance *)c, "fmi2GetInteger", vr[k], &word)) {
            return fmi2Error;
        }
        value[k] = (fmi2Integer)word;
    }
    return fmi2OK;
}

MRD_FUNCTION(fmi2Status, GetBoolean, fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Boolean value[]) {
    size_t k;
    bool is_true;
    for (k = 0U; k < nvr; k++) {
        if (!mrd_fmu_get_truth((mrd_fmu_instance *)c, "fmi2GetBoolean", vr[k], &is_true)) {
            return fmi2Error;
        }
        value[k] = is_true ? 1 : 0;
    }
    return fmi2OK;
}

MRD_FUNCTION(fmi2Status, GetFMUstate, fmi2Component c, fmi2FMUstate *FMUstate) {
    return mrd_status(mrd_fmu_get_state((mrd_fmu_instance *)c, "fmi2GetFMUstate", FMUstate));
}

MRD_FUNCTION(fmi2Status, SetFMUstate, fmi2Component c, fmi2FMUstate FMUstate) {
    return mrd_status(mrd_fmu_set_state((mrd_fmu_instance *)c, "fmi2SetFMUstate", FMUstate));
}

MRD_FUNCTION(fmi2Status, FreeFMUstate, fmi2Component c, fmi2FMUstate *FMUstate) {
    (void)c;
    mrd_fmu_free_state(FMUstate);
    return fmi2OK;
}

MRD_FUNCTION(fmi2Status, SerializedFMUstateSize, fmi2Component c, fmi2FMUstate FMUstate, size_t *size) {
    (void)c;
    (void)FMUstate;
    *size = mrd_fmu_stored_size();
    return fmi2OK;
}

MRD_FUNCTION(fmi2Status, SerializeFMUstate, fmi2Component c, fmi2FMUstate FMUstate, fmi2Byte serializedState[], size_t size) {
    return mrd_status(mrd_fmu_store((mrd_fmu_instance *)c, "fmi2SerializeFMUstate", FMUstate, serializedState, size));
}

MRD_FUNCTION(fmi2Status, DeSerializeFMUstate, fmi2Component c, const fmi2Byte serializedState[], size_t size,
             fmi2FMUstate *FMUstate) {
    return mrd_status(mrd_fmu_restore((mrd_fmu_instance *)c, "fmi2DeSerializeFMUstate", serializedState, size, FMUstate));
}

/* A status that this FMU does not have. */
static fmi2Status mrd_discard(fmi2Component c, const char *function, const char *why) {
    mrd_fmu_fail(&((const mrd_fmu_instance *)c)->logger, function, why);
    return fmi2Discard;
}

MRD_FUNCTION(fmi2Status, GetStatus, fmi2Component c, const fmi2StatusKind s, fmi2Status *value) {
    (void)value;
    (void)s;
    return mrd_discard(c, "fmi2GetStatus", "no step of this FMU runs beside the caller");
}

MRD_FUNCTION(fmi2Status, GetRealStatus, fmi2Component c, const fmi2StatusKind s, fmi2Real *value) {
    if (s == fmi2LastSuccessfulTime) {
        *value = ((const mrd_fmu_instance *)c)->fmu.time_s;
        return fmi2OK;
    }
    return mrd_discard(c, "fmi2GetRealStatus", "this status is not a time");
}

MRD_FUNCTION(fmi2Status, GetIntegerStatus, fmi2Component c, const fmi2StatusKind s, fmi2Integer *value) {
    (void)value;
    (void)s;
    return mrd_discard(c, "fmi2GetIntegerStatus", "there is no such status");
}

MRD_FUNCTION(fmi2Status, GetBooleanStatus, fmi2Component c, const fmi2StatusKind s, fmi2Boolean *value) {
    if (s == fmi2Terminated) {
        *value = 0;
        return fmi2OK;
    }
    return mrd_discard(c, "fmi2GetBooleanStatus", "this status is not a Boolean");
}

MRD_FUNCTION(fmi2Status, GetStringStatus, fmi2Component c, const fmi2StatusKind s, fmi2String *value) {
    (void)value;
    (void)s;
    return mrd_discard(c, "fmi2GetStringStatus", "no step of this FMU runs beside the caller");
}

/* Not supported, for which `why` is the reason. */
#define MRD_REFUSES(why, name, ...)                                                                                              \
    MRD_FUNCTION(fmi2Status, name, __VA_ARGS__) {                                                                                \
        return mrd_result((const mrd_fmu_instance *)c, "fmi2" #name, why);                                                      \
    }

/* Arguments that are not used. */
#define MRD_WHICH fmi2Component c, const fmi2ValueReference vr[], size_t nvr

#if defined(__GNUC__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

MRD_REFUSES("all variables of type Integer are outputs", SetInteger, MRD_WHICH, const fmi2Integer value[])
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
