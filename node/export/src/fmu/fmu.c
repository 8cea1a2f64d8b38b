/* @NAME@_fmu.c: variables, state, and one step. */
#include "@NAME@_fmu.h"

#include <string.h>

/* No fused multiplication and addition, as in @NAME@.c. */
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__)
#pragma GCC optimize("fp-contract=off")
#endif

/* First number and count of each parameter. */
static const uint32_t mrd_fmu_places[][2] = {
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
}

bool mrd_fmu_is_valid(const mrd_fmu *fmu) {
    return fmu->accepted && mrd_fmu_is_finite(fmu->output.force_n);
}

double *mrd_fmu_numbers(mrd_fmu *fmu, uint32_t reference, size_t *count) {
    const size_t parameters = sizeof mrd_fmu_places / sizeof mrd_fmu_places[0];
    *count = 1U;
    if (reference >= MRD_FMU_FIRST_PARAMETER) {
        const uint32_t index = reference - MRD_FMU_FIRST_PARAMETER;
        if (index >= parameters) {
            return NULL;
        }
        *count = mrd_fmu_places[index][1];
        return &fmu->parameters.numbers[mrd_fmu_places[index][0]];
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
    default:
        return NULL;
    }
}

const char *mrd_fmu_set(mrd_fmu *fmu, uint32_t reference, size_t element, double value) {
    size_t count;
    const bool is_parameter = reference >= MRD_FMU_FIRST_PARAMETER;
    const bool is_input = reference >= MRD_FMU_DISPLACEMENT && reference <= MRD_FMU_TEMPERATURE;
    double *numbers = mrd_fmu_numbers(fmu, reference, &count);
    if (numbers == NULL || element >= count || !(is_parameter || is_input)) {
        return "there is no input and no parameter with this value reference";
    }
    if (fmu->mode == MRD_FMU_TERMINATED) {
        return "a variable cannot be set after the simulation has been terminated";
    }
    if (is_parameter && !mrd_fmu_is_finite(value)) {
        return "a parameter must be a finite number; the value before stays";
    }
    numbers[element] = value;
    return NULL;
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
    fmu->time_s = time_s + step_s;
    return NULL;
}

size_t mrd_fmu_stored_size(void) {
    return sizeof MRD_FMU_TOKEN + sizeof(mrd_fmu);
}

void mrd_fmu_store(const mrd_fmu *fmu, unsigned char *bytes) {
    memcpy(bytes, MRD_FMU_TOKEN, sizeof MRD_FMU_TOKEN);
    memcpy(bytes + sizeof MRD_FMU_TOKEN, fmu, sizeof *fmu);
}

const char *mrd_fmu_restore(mrd_fmu *fmu, const unsigned char *bytes, size_t size) {
    if (size != mrd_fmu_stored_size() || memcmp(bytes, MRD_FMU_TOKEN, sizeof MRD_FMU_TOKEN) != 0) {
        return "the stored state is not one of this FMU";
    }
    memcpy(fmu, bytes + sizeof MRD_FMU_TOKEN, sizeof *fmu);
    return NULL;
}
