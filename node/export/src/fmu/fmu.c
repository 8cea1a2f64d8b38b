/* @NAME@_fmu.c: variables, states, the order of calls, messages, and one step. */
#include "@NAME@_fmu.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* No fused multiplication and addition, as in @NAME@.c. */
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__)
#pragma GCC optimize("fp-contract=off")
#endif

/* Each parameter: its first number, its count, and the least and largest value that it may have. */
static const struct {
    uint32_t first, count;
    double least, most;
} mrd_fmu_places[] = {
@PLACES@};

/* The compiler refuses a negative size: every field of mrd_parameters is a double, without padding. */
typedef char mrd_fmu_has_doubles_only[sizeof(mrd_parameters) == MRD_FMU_NUMBERS * sizeof(double) ? 1 : -1];

static double mrd_fmu_nan(void) {
    static const union {
        uint64_t bits;
        double value;
    } nan = { UINT64_C(0x7ff8000000000000) };
    return nan.value;
}

static bool mrd_fmu_is_finite(double value) {
    return value - value == 0.0;
}

void mrd_fmu_fail(const mrd_fmu_logger *to, const char *function, const char *what) {
    if (to->is_on && to->send != NULL) {
        char message[512];
        (void)snprintf(message, sizeof message, "%s: %s.", function, what);
        to->send(to->importer, message);
    }
}

void mrd_fmu_fail_at(const mrd_fmu_logger *to, const char *function, uint32_t reference, const char *what) {
    char message[256];
    (void)snprintf(message, sizeof message, "value reference %lu: %s", (unsigned long)reference, what);
    mrd_fmu_fail(to, function, message);
}

bool mrd_fmu_has_done(const mrd_fmu_logger *to, const char *function, const char *fault) {
    if (fault != NULL) {
        mrd_fmu_fail(to, function, fault);
    }
    return fault == NULL;
}

void mrd_fmu_set_logging(mrd_fmu_logger *of, bool is_on, const char *const categories[], size_t count) {
    size_t k;
    bool is_ours = count == 0U;
    for (k = 0U; k < count; k++) {
        is_ours = is_ours || strcmp(categories[k], "logStatusError") == 0 || strcmp(categories[k], "logAll") == 0;
    }
    of->is_on = is_on && is_ours;
}

#if MRD_HAS_INVERSE
/* The current without a new command. */
static void mrd_fmu_hold_current(mrd_fmu *fmu, int64_t time_ns) {
    fmu->output.current_a = mrd_silent_current_a(&fmu->parameters.named, &fmu->damper, time_ns);
}

#endif
void mrd_fmu_reset(mrd_fmu *fmu) {
    memset(fmu, 0, sizeof *fmu);
    fmu->mode = MRD_FMU_INSTANTIATED;
    fmu->parameters.named = mrd_default_parameters;
@STARTS@    fmu->output.force_n = mrd_fmu_nan();
    fmu->output.reading_n = mrd_fmu_nan();
    fmu->output.displacement_m = mrd_fmu_nan();
    fmu->output.velocity_m_s = mrd_fmu_nan();
    fmu->output.flags = MRD_SETTLING;
    mrd_reset(&fmu->damper);
#if MRD_HAS_INVERSE
    fmu->output.requested_n = mrd_fmu_nan();
    fmu->output.expected_n = mrd_fmu_nan();
    fmu->output.achievable_n[0] = mrd_fmu_nan();
    fmu->output.achievable_n[1] = mrd_fmu_nan();
    fmu->output.limited_by = MRD_LIMITED_BY_SAFE;
    mrd_fmu_hold_current(fmu, 0);
#endif
}

/* The numbers of a floating-point variable, and how many; NULL if there is none with this reference. */
static double *mrd_fmu_numbers(mrd_fmu *fmu, uint32_t reference, size_t *count) {
    const size_t parameters = sizeof mrd_fmu_places / sizeof mrd_fmu_places[0];
    *count = 1U;
    if (reference >= MRD_FMU_FIRST_PARAMETER) {
        const uint32_t index = reference - MRD_FMU_FIRST_PARAMETER;
        if (index >= parameters) {
            return NULL;
        }
        *count = mrd_fmu_places[index].count;
        return &fmu->parameters.numbers[mrd_fmu_places[index].first];
    }
    switch (reference) {
    case MRD_FMU_TIME:
        return &fmu->time_s;
@INPUTS@    case MRD_FMU_FORCE:
        return &fmu->output.force_n;
    case MRD_FMU_READING:
        return &fmu->output.reading_n;
    case MRD_FMU_USED_DISPLACEMENT:
        return &fmu->output.displacement_m;
    case MRD_FMU_USED_VELOCITY:
        return &fmu->output.velocity_m_s;
#if MRD_HAS_INVERSE
    case MRD_FMU_CURRENT:
        return &fmu->output.current_a;
    case MRD_FMU_REQUESTED:
        return &fmu->output.requested_n;
    case MRD_FMU_EXPECTED:
        return &fmu->output.expected_n;
#if MRD_HAS_ARRAYS
    case MRD_FMU_ACHIEVABLE:
        *count = 2U;
        return fmu->output.achievable_n;
#else
    case MRD_FMU_LEAST:
        return &fmu->output.achievable_n[0];
    case MRD_FMU_MOST:
        return &fmu->output.achievable_n[1];
#endif
#endif
    default:
        return NULL;
    }
}

/* Sets the numbers of an input or a parameter. Returns NULL, or what is wrong; then the values before stay. */
static const char *mrd_fmu_set(mrd_fmu *fmu, uint32_t reference, const double values[]) {
    size_t k, count;
    const bool is_parameter = reference >= MRD_FMU_FIRST_PARAMETER;
    const bool is_input = reference >= MRD_FMU_DISPLACEMENT && reference < MRD_FMU_FORCE;
    double *numbers = mrd_fmu_numbers(fmu, reference, &count);
    if (numbers == NULL || !(is_parameter || is_input)) {
        return "there is no input and no parameter with this value reference";
    }
    if (fmu->mode == MRD_FMU_TERMINATED) {
        return "a variable cannot be set after the simulation has been terminated";
    }
    for (k = 0U; is_parameter && k < count; k++) {
        const uint32_t index = reference - MRD_FMU_FIRST_PARAMETER;
        /* False for NaN. */
        if (!(values[k] >= mrd_fmu_places[index].least && values[k] <= mrd_fmu_places[index].most)) {
            return "a parameter must be a finite number from its min to its max; the value before stays";
        }
    }
    memcpy(numbers, values, count * sizeof *numbers);
#if MRD_HAS_INVERSE
    if (!fmu->has_stepped) {
        mrd_fmu_hold_current(fmu, 0);
    }
#endif
    return NULL;
}

#define MRD_FMU_NO_NUMBER "there is no such variable with floating-point numbers"
#define MRD_FMU_NO_COUNT "there are fewer values than the variables have elements, or more"

bool mrd_fmu_get_numbers(mrd_fmu_instance *of, const char *function, const uint32_t references[], size_t variables, double values[],
                         size_t count) {
    size_t k, elements, at = 0U;
    for (k = 0U; k < variables; k++) {
        const double *numbers = mrd_fmu_numbers(&of->fmu, references[k], &elements);
        if (numbers == NULL || elements > count - at) {
            mrd_fmu_fail_at(&of->logger, function, references[k], numbers == NULL ? MRD_FMU_NO_NUMBER : MRD_FMU_NO_COUNT);
            return false;
        }
        memcpy(values + at, numbers, elements * sizeof *values);
        at += elements;
    }
    return mrd_fmu_has_done(&of->logger, function, at == count ? NULL : MRD_FMU_NO_COUNT);
}

bool mrd_fmu_set_numbers(mrd_fmu_instance *of, const char *function, const uint32_t references[], size_t variables,
                         const double values[], size_t count) {
    size_t k, elements, at = 0U;
    for (k = 0U; k < variables; k++) {
        const char *fault = MRD_FMU_NO_NUMBER;
        if (mrd_fmu_numbers(&of->fmu, references[k], &elements) != NULL) {
            fault = elements > count - at ? MRD_FMU_NO_COUNT : mrd_fmu_set(&of->fmu, references[k], values + at);
        }
        if (fault != NULL) {
            mrd_fmu_fail_at(&of->logger, function, references[k], fault);
            return false;
        }
        at += elements;
    }
    return mrd_fmu_has_done(&of->logger, function, at == count ? NULL : MRD_FMU_NO_COUNT);
}

bool mrd_fmu_get_word(const mrd_fmu_instance *of, const char *function, uint32_t reference, uint32_t *value) {
    switch (reference) {
    case MRD_FMU_FLAGS:
        *value = of->fmu.output.flags;
        return true;
#if MRD_HAS_INVERSE
    case MRD_FMU_LIMITED_BY:
        *value = of->fmu.output.limited_by;
        return true;
#endif
    default:
        mrd_fmu_fail_at(&of->logger, function, reference, "there is no such variable with integers");
        return false;
    }
}

bool mrd_fmu_get_truth(const mrd_fmu_instance *of, const char *function, uint32_t reference, bool *value) {
    switch (reference) {
    case MRD_FMU_VALID:
        *value = of->fmu.accepted && mrd_fmu_is_finite(of->fmu.output.force_n);
        return true;
    case MRD_FMU_ACCEPTED:
        *value = of->fmu.accepted;
        return true;
#if MRD_HAS_INVERSE
    case MRD_FMU_IS_COMMANDED:
        *value = of->fmu.output.is_commanded;
        return true;
    case MRD_FMU_IS_ACHIEVABLE:
        *value = of->fmu.output.is_achievable;
        return true;
    case MRD_FMU_IS_DISSIPATIVE:
        *value = of->fmu.output.is_dissipative;
        return true;
#if MRD_INVERSE_LEARNED
    case MRD_FMU_IS_SUBSTITUTED:
        *value = of->fmu.output.is_substituted;
        return true;
#endif
#endif
    default:
        mrd_fmu_fail_at(&of->logger, function, reference, "there is no such variable of type Boolean");
        return false;
    }
}

const char *mrd_fmu_enter_initialization(mrd_fmu *fmu, double start_s) {
    if (fmu->mode != MRD_FMU_INSTANTIATED) {
        return "initialization follows instantiation or reset";
    }
    fmu->time_s = start_s;
    fmu->mode = MRD_FMU_INITIALIZING;
    return NULL;
}

const char *mrd_fmu_exit_initialization(mrd_fmu *fmu) {
    if (fmu->mode != MRD_FMU_INITIALIZING) {
        return "initialization has not been entered";
    }
    fmu->mode = MRD_FMU_STEPPING;
    return NULL;
}

const char *mrd_fmu_terminate(mrd_fmu *fmu) {
    if (fmu->mode != MRD_FMU_STEPPING) {
        return "only a simulation that has been initialized can be terminated";
    }
    fmu->mode = MRD_FMU_TERMINATED;
    return NULL;
}

/* The nearest nanosecond; false beyond 9e9 s. */
static bool mrd_fmu_to_ns(double time_s, int64_t *time_ns) {
    double all_ns, rest_ns;
    if (!(time_s >= -9e9 && time_s <= 9e9)) {
        return false;
    }
    all_ns = time_s * 1e9;
    *time_ns = (int64_t)all_ns;
    rest_ns = all_ns - (double)*time_ns;
    if (rest_ns >= 0.5) {
        *time_ns += 1;
    } else if (rest_ns <= -0.5) {
        *time_ns -= 1;
    }
    return true;
}

const char *mrd_fmu_step(mrd_fmu *fmu, double time_s, double step_s) {
    int64_t time_ns;
    if (fmu->mode != MRD_FMU_STEPPING) {
        return "a step is possible only between initialization and termination";
    }
    if (!(step_s > 0.0) || !mrd_fmu_is_finite(step_s)) {
        return "the communication step size must be above 0 s";
    }
    if (!mrd_fmu_to_ns(time_s, &time_ns)) {
        return "the communication point must be a time within 9e9 s";
    }
    if (fmu->has_stepped && time_ns <= fmu->input.time_ns) {
        return "the communication point must be at least 1 ns later than that of the step before; set an FMU state to go back";
    }
    fmu->input.time_ns = time_ns;
    fmu->has_stepped = true;
    fmu->accepted = mrd_step(&fmu->parameters.named, &fmu->damper, &fmu->input, &fmu->output);
#if MRD_HAS_INVERSE
    if (!fmu->accepted) {
        mrd_fmu_hold_current(fmu, time_ns);
    }
#endif
    fmu->time_s = time_s + step_s;
    return NULL;
}

bool mrd_fmu_get_state(const mrd_fmu_instance *of, const char *function, void **state) {
    if (*state == NULL) {
        *state = malloc(sizeof of->fmu);
    }
    if (*state == NULL) {
        mrd_fmu_fail(&of->logger, function, "there is no memory");
        return false;
    }
    memcpy(*state, &of->fmu, sizeof of->fmu);
    return true;
}

bool mrd_fmu_set_state(mrd_fmu_instance *of, const char *function, const void *state) {
    if (state == NULL) {
        mrd_fmu_fail(&of->logger, function, "there is no state");
        return false;
    }
    memcpy(&of->fmu, state, sizeof of->fmu);
    return true;
}

void mrd_fmu_free_state(void **state) {
    if (state != NULL) {
        free(*state);
        *state = NULL;
    }
}

size_t mrd_fmu_stored_size(void) {
    return sizeof MRD_FMU_TOKEN + sizeof(mrd_fmu);
}

bool mrd_fmu_store(const mrd_fmu_instance *of, const char *function, const void *state, void *bytes, size_t size) {
    if (state == NULL || size < mrd_fmu_stored_size()) {
        mrd_fmu_fail(&of->logger, function, "there is no state, or the buffer is too short for it");
        return false;
    }
    memcpy(bytes, MRD_FMU_TOKEN, sizeof MRD_FMU_TOKEN);
    memcpy((unsigned char *)bytes + sizeof MRD_FMU_TOKEN, state, sizeof(mrd_fmu));
    return true;
}

bool mrd_fmu_restore(const mrd_fmu_instance *of, const char *function, const void *bytes, size_t size, void **state) {
    if (size != mrd_fmu_stored_size() || memcmp(bytes, MRD_FMU_TOKEN, sizeof MRD_FMU_TOKEN) != 0) {
        mrd_fmu_fail(&of->logger, function, "the stored state is not one of this FMU");
        return false;
    }
    if (*state == NULL) {
        *state = malloc(sizeof(mrd_fmu));
    }
    if (*state == NULL) {
        mrd_fmu_fail(&of->logger, function, "there is no memory");
        return false;
    }
    memcpy(*state, (const unsigned char *)bytes + sizeof MRD_FMU_TOKEN, sizeof(mrd_fmu));
    return true;
}
