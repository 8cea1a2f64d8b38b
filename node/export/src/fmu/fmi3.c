/* @NAME@_fmi3.c: the functions of FMI 3.0 (Functional Mock-up Interface, Modelica Association) for co-simulation.
   Functions of other interface types, and of types that no variable has, return fmi3Error and say why. */
#include <stdlib.h>
#include <string.h>

/* With FMI3_FUNCTION_PREFIX the functions have names of their own, so that they can be linked statically. */
#ifdef FMI3_FUNCTION_PREFIX
#define MRD_IS_STATIC
#define MRD_FMI(name) MRD_JOIN_BOTH(FMI3_FUNCTION_PREFIX, fmi3##name)
#else
#define MRD_FMI(name) fmi3##name
#endif

#include "@NAME@_fmu.h"

/* Types of the standard, as far as they are needed: section 2.2 of FMI 3.0. */
typedef void *fmi3Instance;
typedef void *fmi3InstanceEnvironment;
typedef void *fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef float fmi3Float32;
typedef double fmi3Float64;
typedef int8_t fmi3Int8;
typedef uint8_t fmi3UInt8;
typedef int16_t fmi3Int16;
typedef uint16_t fmi3UInt16;
typedef int32_t fmi3Int32;
typedef uint32_t fmi3UInt32;
typedef int64_t fmi3Int64;
typedef uint64_t fmi3UInt64;
typedef bool fmi3Boolean;
typedef const char *fmi3String;
typedef uint8_t fmi3Byte;
typedef const fmi3Byte *fmi3Binary;
typedef bool fmi3Clock;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef int fmi3DependencyKind;
typedef int fmi3IntervalQualifier;
typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmi3Status, fmi3String category, fmi3String message);
typedef void (*fmi3ClockUpdateCallback)(fmi3InstanceEnvironment);
typedef void (*fmi3IntermediateUpdateCallback)(fmi3InstanceEnvironment, fmi3Float64, fmi3Boolean, fmi3Boolean, fmi3Boolean,
                                               fmi3Boolean, fmi3Boolean *, fmi3Float64 *);
typedef void (*fmi3LockPreemptionCallback)(void);

/* The importer: where messages go. */
typedef struct {
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} mrd_importer;

/* One instance. Its pointer is also one to what the versions share. */
typedef struct {
    mrd_fmu_instance shared;
    mrd_importer importer;
} mrd_instance;

static void mrd_send(const void *importer, const char *message) {
    const mrd_importer *to = (const mrd_importer *)importer;
    if (to->log != NULL) {
        to->log(to->environment, fmi3Error, "logStatusError", message);
    }
}

static fmi3Status mrd_status(bool is_done) {
    return is_done ? fmi3OK : fmi3Error;
}

/* The status of a change of modes or a step. */
static fmi3Status mrd_result(const mrd_fmu_instance *of, const char *function, const char *fault) {
    return mrd_status(mrd_fmu_has_done(&of->logger, function, fault));
}

#define MRD_NO_TYPE "this FMU has no variable of this type"
#define MRD_NO_COUNT "there are fewer values than variables, or more"

MRD_FUNCTION(const char *, GetVersion, void) {
    return "3.0";
}

MRD_FUNCTION(fmi3Status, SetDebugLogging, fmi3Instance instance, fmi3Boolean loggingOn, size_t nCategories,
             const fmi3String categories[]) {
    mrd_fmu_set_logging(&((mrd_fmu_instance *)instance)->logger, loggingOn, categories, nCategories);
    return fmi3OK;
}

MRD_FUNCTION(fmi3Instance, InstantiateCoSimulation, fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath,
             fmi3Boolean visible, fmi3Boolean loggingOn, fmi3Boolean eventModeUsed, fmi3Boolean earlyReturnAllowed,
             const fmi3ValueReference requiredIntermediateVariables[], size_t nRequiredIntermediateVariables,
             fmi3InstanceEnvironment instanceEnvironment, fmi3LogMessageCallback logMessage,
             fmi3IntermediateUpdateCallback intermediateUpdate) {
    const mrd_importer importer = { instanceEnvironment, logMessage };
    const mrd_fmu_logger logger = { loggingOn, mrd_send, &importer };
    const char *fault = NULL;
    mrd_instance *of = NULL;
    (void)instanceName;
    (void)resourcePath;
    (void)visible;
    (void)earlyReturnAllowed;
    (void)requiredIntermediateVariables;
    (void)intermediateUpdate;
    if (instantiationToken == NULL || strcmp(instantiationToken, MRD_FMU_TOKEN) != 0) {
        fault = "the instantiation token is not that of this FMU";
    } else if (eventModeUsed || nRequiredIntermediateVariables > 0U) {
        fault = "this FMU has no event mode and no intermediate update";
    } else {
        of = (mrd_instance *)calloc(1U, sizeof *of);
        fault = of == NULL ? "there is no memory" : NULL;
    }
    if (of == NULL) {
        mrd_fmu_fail(&logger, "fmi3InstantiateCoSimulation", fault);
        return NULL;
    }
    of->importer = importer;
    of->shared.logger = logger;
    of->shared.logger.importer = &of->importer;
    mrd_fmu_reset(&of->shared.fmu);
    return of;
}

MRD_FUNCTION(void, FreeInstance, fmi3Instance instance) {
    free(instance);
}

MRD_FUNCTION(fmi3Status, EnterInitializationMode, fmi3Instance instance, fmi3Boolean toleranceDefined, fmi3Float64 tolerance,
             fmi3Float64 startTime, fmi3Boolean stopTimeDefined, fmi3Float64 stopTime) {
    mrd_fmu_instance *of = (mrd_fmu_instance *)instance;
    (void)toleranceDefined;
    (void)tolerance;
    (void)stopTimeDefined;
    (void)stopTime;
    return mrd_result(of, "fmi3EnterInitializationMode", mrd_fmu_enter_initialization(&of->fmu, startTime));
}

MRD_FUNCTION(fmi3Status, ExitInitializationMode, fmi3Instance instance) {
    mrd_fmu_instance *of = (mrd_fmu_instance *)instance;
    return mrd_result(of, "fmi3ExitInitializationMode", mrd_fmu_exit_initialization(&of->fmu));
}

MRD_FUNCTION(fmi3Status, Terminate, fmi3Instance instance) {
    mrd_fmu_instance *of = (mrd_fmu_instance *)instance;
    return mrd_result(of, "fmi3Terminate", mrd_fmu_terminate(&of->fmu));
}

MRD_FUNCTION(fmi3Status, Reset, fmi3Instance instance) {
    mrd_fmu_reset(&((mrd_fmu_instance *)instance)->fmu);
    return fmi3OK;
}

MRD_FUNCTION(fmi3Status, DoStep, fmi3Instance instance, fmi3Float64 currentCommunicationPoint, fmi3Float64 communicationStepSize,
             fmi3Boolean noSetFMUStatePriorToCurrentPoint, fmi3Boolean *eventHandlingNeeded, fmi3Boolean *terminateSimulation,
             fmi3Boolean *earlyReturn, fmi3Float64 *lastSuccessfulTime) {
    mrd_fmu_instance *of = (mrd_fmu_instance *)instance;
    const char *fault = mrd_fmu_step(&of->fmu, currentCommunicationPoint, communicationStepSize);
    (void)noSetFMUStatePriorToCurrentPoint;
    *eventHandlingNeeded = false;
    *terminateSimulation = false;
    *earlyReturn = false;
    *lastSuccessfulTime = of->fmu.time_s;
    return mrd_result(of, "fmi3DoStep", fault);
}

MRD_FUNCTION(fmi3Status, GetFloat64, fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
             fmi3Float64 values[], size_t nValues) {
    mrd_fmu_instance *of = (mrd_fmu_instance *)instance;
    return mrd_status(mrd_fmu_get_numbers(of, "fmi3GetFloat64", valueReferences, nValueReferences, values, nValues));
}

MRD_FUNCTION(fmi3Status, SetFloat64, fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
             const fmi3Float64 values[], size_t nValues) {
    mrd_fmu_instance *of = (mrd_fmu_instance *)instance;
    return mrd_status(mrd_fmu_set_numbers(of, "fmi3SetFloat64", valueReferences, nValueReferences, values, nValues));
}

MRD_FUNCTION(fmi3Status, GetUInt32, fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
             fmi3UInt32 values[], size_t nValues) {
    mrd_fmu_instance *of = (mrd_fmu_instance *)instance;
    bool is_done = mrd_fmu_has_done(&of->logger, "fmi3GetUInt32", nValues == nValueReferences ? NULL : MRD_NO_COUNT);
    size_t k;
    for (k = 0U; is_done && k < nValueReferences; k++) {
        is_done = mrd_fmu_get_word(of, "fmi3GetUInt32", valueReferences[k], &values[k]);
    }
    return mrd_status(is_done);
}

MRD_FUNCTION(fmi3Status, GetBoolean, fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
             fmi3Boolean values[], size_t nValues) {
    mrd_fmu_instance *of = (mrd_fmu_instance *)instance;
    bool is_done = mrd_fmu_has_done(&of->logger, "fmi3GetBoolean", nValues == nValueReferences ? NULL : MRD_NO_COUNT);
    size_t k;
    for (k = 0U; is_done && k < nValueReferences; k++) {
        is_done = mrd_fmu_get_truth(of, "fmi3GetBoolean", valueReferences[k], &values[k]);
    }
    return mrd_status(is_done);
}

MRD_FUNCTION(fmi3Status, GetFMUState, fmi3Instance instance, fmi3FMUState *FMUState) {
    return mrd_status(mrd_fmu_get_state((mrd_fmu_instance *)instance, "fmi3GetFMUState", FMUState));
}

MRD_FUNCTION(fmi3Status, SetFMUState, fmi3Instance instance, fmi3FMUState FMUState) {
    return mrd_status(mrd_fmu_set_state((mrd_fmu_instance *)instance, "fmi3SetFMUState", FMUState));
}

MRD_FUNCTION(fmi3Status, FreeFMUState, fmi3Instance instance, fmi3FMUState *FMUState) {
    (void)instance;
    mrd_fmu_free_state(FMUState);
    return fmi3OK;
}

MRD_FUNCTION(fmi3Status, SerializedFMUStateSize, fmi3Instance instance, fmi3FMUState FMUState, size_t *size) {
    (void)instance;
    (void)FMUState;
    *size = mrd_fmu_stored_size();
    return fmi3OK;
}

MRD_FUNCTION(fmi3Status, SerializeFMUState, fmi3Instance instance, fmi3FMUState FMUState, fmi3Byte serializedState[], size_t size) {
    return mrd_status(mrd_fmu_store((mrd_fmu_instance *)instance, "fmi3SerializeFMUState", FMUState, serializedState, size));
}

MRD_FUNCTION(fmi3Status, DeserializeFMUState, fmi3Instance instance, const fmi3Byte serializedState[], size_t size,
             fmi3FMUState *FMUState) {
    return mrd_status(mrd_fmu_restore((mrd_fmu_instance *)instance, "fmi3DeserializeFMUState", serializedState, size, FMUState));
}

/* Not supported, for which `why` is the reason: other interface types, other types of variables, clocks, derivatives. */
#define MRD_REFUSES(why, name, ...)                                                                                              \
    MRD_FUNCTION(fmi3Status, name, __VA_ARGS__) {                                                                                \
        return mrd_result((mrd_fmu_instance *)instance, "fmi3" #name, why);                                                      \
    }

/* Arguments that are not used. */
#define MRD_WHICH fmi3Instance instance, const fmi3ValueReference r[], size_t n

#if defined(__GNUC__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

MRD_FUNCTION(fmi3Instance, InstantiateModelExchange, fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath,
             fmi3Boolean visible, fmi3Boolean loggingOn, fmi3InstanceEnvironment instanceEnvironment,
             fmi3LogMessageCallback logMessage) {
    if (loggingOn && logMessage != NULL) {
        logMessage(instanceEnvironment, fmi3Error, "logStatusError", "fmi3InstantiateModelExchange: this FMU is for co-simulation.");
    }
    return NULL;
}

MRD_FUNCTION(fmi3Instance, InstantiateScheduledExecution, fmi3String instanceName, fmi3String instantiationToken,
             fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn, fmi3InstanceEnvironment instanceEnvironment,
             fmi3LogMessageCallback logMessage, fmi3ClockUpdateCallback clockUpdate, fmi3LockPreemptionCallback lockPreemption,
             fmi3LockPreemptionCallback unlockPreemption) {
    if (loggingOn && logMessage != NULL) {
        logMessage(instanceEnvironment, fmi3Error, "logStatusError", "fmi3InstantiateScheduledExecution: this FMU is for co-simulation.");
    }
    return NULL;
}

MRD_REFUSES(MRD_NO_TYPE, GetFloat32, MRD_WHICH, fmi3Float32 values[], size_t nValues)
MRD_REFUSES(MRD_NO_TYPE, SetFloat32, MRD_WHICH, const fmi3Float32 values[], size_t nValues)
MRD_REFUSES(MRD_NO_TYPE, GetInt8, MRD_WHICH, fmi3Int8 values[], size_t nValues)
MRD_REFUSES(MRD_NO_TYPE, SetInt8, MRD_WHICH, const fmi3Int8 values[], size_t nValues)
MRD_REFUSES(MRD_NO_TYPE, GetUInt8, MRD_WHICH, fmi3UInt8 values[], size_t nValues)
MRD_REFUSES(MRD_NO_TYPE, SetUInt8, MRD_WHICH, const fmi3UInt8 values[], size_t nValues)
MRD_REFUSES(MRD_NO_TYPE, GetInt16, MRD_WHICH, fmi3Int16 values[], size_t nValues)
MRD_REFUSES(MRD_NO_TYPE, SetInt16, MRD_WHICH, const fmi3Int16 values[], size_t nValues)
MRD_REFUSES(MRD_NO_TYPE, GetUInt16, MRD_WHICH, fmi3UInt16 values[], size_t nValues)
MRD_REFUSES(MRD_NO_TYPE, SetUInt16, MRD_WHICH, const fmi3UInt16 values[], size_t nValues)
MRD_REFUSES(MRD_NO_TYPE, GetInt32, MRD_WHICH, fmi3Int32 values[], size_t nValues)
MRD_REFUSES(MRD_NO_TYPE, SetInt32, MRD_WHICH, const fmi3Int32 values[], size_t nValues)
MRD_REFUSES("all variables of type UInt32 are outputs", SetUInt32, MRD_WHICH, const fmi3UInt32 values[], size_t nValues)
MRD_REFUSES(MRD_NO_TYPE, GetInt64, MRD_WHICH, fmi3Int64 values[], size_t nValues)
MRD_REFUSES(MRD_NO_TYPE, SetInt64, MRD_WHICH, const fmi3Int64 values[], size_t nValues)
MRD_REFUSES(MRD_NO_TYPE, GetUInt64, MRD_WHICH, fmi3UInt64 values[], size_t nValues)
MRD_REFUSES(MRD_NO_TYPE, SetUInt64, MRD_WHICH, const fmi3UInt64 values[], size_t nValues)
MRD_REFUSES("all variables of type Boolean are outputs", SetBoolean, MRD_WHICH, const fmi3Boolean values[], size_t nValues)
MRD_REFUSES(MRD_NO_TYPE, GetString, MRD_WHICH, fmi3String values[], size_t nValues)
MRD_REFUSES(MRD_NO_TYPE, SetString, MRD_WHICH, const fmi3String values[], size_t nValues)
MRD_REFUSES(MRD_NO_TYPE, GetBinary, MRD_WHICH, size_t valueSizes[], fmi3Binary values[], size_t nValues)
MRD_REFUSES(MRD_NO_TYPE, SetBinary, MRD_WHICH, const size_t valueSizes[], const fmi3Binary values[], size_t nValues)
MRD_REFUSES(MRD_NO_TYPE, GetClock, MRD_WHICH, fmi3Clock values[])
MRD_REFUSES(MRD_NO_TYPE, SetClock, MRD_WHICH, const fmi3Clock values[])

#define MRD_NO_DEPENDENCIES "no array of this FMU changes its dependencies"
MRD_REFUSES(MRD_NO_DEPENDENCIES, GetNumberOfVariableDependencies, fmi3Instance instance, fmi3ValueReference valueReference,
            size_t *nDependencies)
MRD_REFUSES(MRD_NO_DEPENDENCIES, GetVariableDependencies, fmi3Instance instance, fmi3ValueReference dependent,
            size_t elementIndicesOfDependent[], fmi3ValueReference independents[], size_t elementIndicesOfIndependents[],
            fmi3DependencyKind dependencyKinds[], size_t nDependencies)

#define MRD_NO_DERIVATIVES "this FMU gives no derivatives"
MRD_REFUSES(MRD_NO_DERIVATIVES, GetDirectionalDerivative, fmi3Instance instance, const fmi3ValueReference unknowns[],
            size_t nUnknowns, const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[], size_t nSeed,
            fmi3Float64 sensitivity[], size_t nSensitivity)
MRD_REFUSES(MRD_NO_DERIVATIVES, GetAdjointDerivative, fmi3Instance instance, const fmi3ValueReference unknowns[], size_t nUnknowns,
            const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[], size_t nSeed, fmi3Float64 sensitivity[],
            size_t nSensitivity)
MRD_REFUSES(MRD_NO_DERIVATIVES, GetOutputDerivatives, MRD_WHICH, const fmi3Int32 orders[], fmi3Float64 values[], size_t nValues)

#define MRD_NO_STRUCTURE "this FMU has no structural parameters"
MRD_REFUSES(MRD_NO_STRUCTURE, EnterConfigurationMode, fmi3Instance instance)
MRD_REFUSES(MRD_NO_STRUCTURE, ExitConfigurationMode, fmi3Instance instance)

#define MRD_NO_CLOCKS "this FMU has no event mode and no clocks"
MRD_REFUSES("this FMU has no event mode, and is in step mode after initialization", EnterStepMode, fmi3Instance instance)
MRD_REFUSES(MRD_NO_CLOCKS, EnterEventMode, fmi3Instance instance)
MRD_REFUSES(MRD_NO_CLOCKS, GetIntervalDecimal, MRD_WHICH, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
MRD_REFUSES(MRD_NO_CLOCKS, GetIntervalFraction, MRD_WHICH, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
            fmi3IntervalQualifier qualifiers[])
MRD_REFUSES(MRD_NO_CLOCKS, GetShiftDecimal, MRD_WHICH, fmi3Float64 shifts[])
MRD_REFUSES(MRD_NO_CLOCKS, GetShiftFraction, MRD_WHICH, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
MRD_REFUSES(MRD_NO_CLOCKS, SetIntervalDecimal, MRD_WHICH, const fmi3Float64 intervals[])
MRD_REFUSES(MRD_NO_CLOCKS, SetIntervalFraction, MRD_WHICH, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
MRD_REFUSES(MRD_NO_CLOCKS, SetShiftDecimal, MRD_WHICH, const fmi3Float64 shifts[])
MRD_REFUSES(MRD_NO_CLOCKS, SetShiftFraction, MRD_WHICH, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
MRD_REFUSES(MRD_NO_CLOCKS, EvaluateDiscreteStates, fmi3Instance instance)
MRD_REFUSES(MRD_NO_CLOCKS, UpdateDiscreteStates, fmi3Instance instance, fmi3Boolean *discreteStatesNeedUpdate,
            fmi3Boolean *terminateSimulation, fmi3Boolean *nominalsOfContinuousStatesChanged,
            fmi3Boolean *valuesOfContinuousStatesChanged, fmi3Boolean *nextEventTimeDefined, fmi3Float64 *nextEventTime)
MRD_REFUSES(MRD_NO_CLOCKS, ActivateModelPartition, fmi3Instance instance, fmi3ValueReference clockReference,
            fmi3Float64 activationTime)

#define MRD_NO_EXCHANGE "this FMU is for co-simulation"
MRD_REFUSES(MRD_NO_EXCHANGE, EnterContinuousTimeMode, fmi3Instance instance)
MRD_REFUSES(MRD_NO_EXCHANGE, CompletedIntegratorStep, fmi3Instance instance, fmi3Boolean noSetFMUStatePriorToCurrentPoint,
            fmi3Boolean *enterEventMode, fmi3Boolean *terminateSimulation)
MRD_REFUSES(MRD_NO_EXCHANGE, SetTime, fmi3Instance instance, fmi3Float64 time)
MRD_REFUSES(MRD_NO_EXCHANGE, SetContinuousStates, fmi3Instance instance, const fmi3Float64 continuousStates[], size_t nStates)
MRD_REFUSES(MRD_NO_EXCHANGE, GetContinuousStateDerivatives, fmi3Instance instance, fmi3Float64 derivatives[], size_t nStates)
MRD_REFUSES(MRD_NO_EXCHANGE, GetEventIndicators, fmi3Instance instance, fmi3Float64 eventIndicators[], size_t nEventIndicators)
MRD_REFUSES(MRD_NO_EXCHANGE, GetContinuousStates, fmi3Instance instance, fmi3Float64 continuousStates[], size_t nStates)
MRD_REFUSES(MRD_NO_EXCHANGE, GetNominalsOfContinuousStates, fmi3Instance instance, fmi3Float64 nominals[], size_t nStates)
MRD_REFUSES(MRD_NO_EXCHANGE, GetNumberOfEventIndicators, fmi3Instance instance, size_t *nEventIndicators)
MRD_REFUSES(MRD_NO_EXCHANGE, GetNumberOfContinuousStates, fmi3Instance instance, size_t *nContinuousStates)

#if defined(__GNUC__)
#pragma GCC diagnostic pop
#endif
