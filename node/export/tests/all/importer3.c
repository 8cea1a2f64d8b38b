/* An importer of an FMI 3.0 FMU for co-simulation, linked to its sources. Its arguments are the instantiation token, the value
   reference of a parameter, and the value references of the inputs among the readings; with the fifth one, the FMU has an inverse
   controller. It reads readings, and writes what the FMU gives.
   Types and prototypes are written after the standard, independently of the FMU. */
#include "importer.h"

typedef void (*log_callback)(void *environment, int status, const char *category, const char *message);
const char *fmi3GetVersion(void);
void *fmi3InstantiateCoSimulation(const char *, const char *, const char *, bool, bool, bool, bool, const uint32_t[], size_t, void *,
                                  log_callback, void (*)(void));
void *fmi3InstantiateModelExchange(const char *, const char *, const char *, bool, bool, void *, log_callback);
void fmi3FreeInstance(void *);
int fmi3SetDebugLogging(void *, bool, size_t, const char *const[]);
int fmi3EnterInitializationMode(void *, bool, double, double, bool, double);
int fmi3ExitInitializationMode(void *);
int fmi3EnterStepMode(void *);
int fmi3EnterConfigurationMode(void *);
int fmi3Terminate(void *);
int fmi3Reset(void *);
int fmi3SetFloat64(void *, const uint32_t[], size_t, const double[], size_t);
int fmi3GetFloat64(void *, const uint32_t[], size_t, double[], size_t);
int fmi3GetUInt32(void *, const uint32_t[], size_t, uint32_t[], size_t);
int fmi3GetBoolean(void *, const uint32_t[], size_t, bool[], size_t);
int fmi3GetInt32(void *, const uint32_t[], size_t, int32_t[], size_t);
int fmi3SetBoolean(void *, const uint32_t[], size_t, const bool[], size_t);
int fmi3GetFMUState(void *, void **);
int fmi3SetFMUState(void *, void *);
int fmi3FreeFMUState(void *, void **);
int fmi3SerializedFMUStateSize(void *, void *, size_t *);
int fmi3SerializeFMUState(void *, void *, uint8_t[], size_t);
int fmi3DeserializeFMUState(void *, const uint8_t[], size_t, void **);
int fmi3DoStep(void *, double, double, bool, bool *, bool *, bool *, double *);

static void keep(void *environment, int status, const char *category, const char *message) {
    last_message *last = environment;
    if (status == ERROR && strcmp(category, "logStatusError") == 0) {
        (void)snprintf(last->text, sizeof last->text, "%s", message);
    }
}

static int step(void *fmu, double time_s, double step_s) {
    bool event = true, terminate = true, early = true;
    double reached_s = -1.0;
    const int status = fmi3DoStep(fmu, time_s, step_s, true, &event, &terminate, &early, &reached_s);
    if (status == OK && (event || terminate || early || reached_s != time_s + step_s)) {
        return -1;
    }
    return status;
}

static int has_force(void *fmu, double *force) {
    const uint32_t which = 11U;
    return fmi3GetFloat64(fmu, &which, 1U, force, 1U);
}

/* Writes the command after a step. */
static int get_command(void *fmu) {
    const uint32_t forces[4] = { 21U, 22U, 23U, 24U }, limited_by = 26U, which[3] = { 27U, 28U, 29U };
    double numbers[5];
    bool truths[3];
    uint32_t limit;
    if (fmi3GetFloat64(fmu, forces, 4U, numbers, 5U) != OK || fmi3GetUInt32(fmu, &limited_by, 1U, &limit, 1U) != OK
        || fmi3GetBoolean(fmu, which, 3U, truths, 3U) != OK) {
        return ERROR;
    }
    write_command(numbers, limit, truths);
    return OK;
}

/* The commanded current, NaN if it cannot be read. */
static double current_of(void *fmu) {
    const uint32_t current = 21U;
    double value = 0.0;
    return fmi3GetFloat64(fmu, &current, 1U, &value, 1U) == OK ? value : 0.0 / value;
}

int main(int count, char **arguments) {
    static last_message message_of;
    const char *token = count > 2 ? arguments[1] : "";
    const uint32_t parameter = count > 2 ? (uint32_t)strtoul(arguments[2], NULL, 10) : 0U;
    const uint32_t estimates[2] = { 11U, 12U }, flags = 15U, truths[2] = { 16U, 17U }, displacement = 1U;
    uint32_t inputs[5];
    bool has_inverse = false;
    size_t channels[5], k, n = 0U, size = 0U;
    const char *own_category = "logStatusError", *other_category = "logEvents";
    void *fmu, *state = NULL, *copy = NULL;
    uint8_t *bytes;
    int64_t time_ns;
    double given[5], force = 0.0, again = 0.0, value = 0.0, nan;

    NEED(strcmp(fmi3GetVersion(), "3.0") == 0);
    NEED(fmi3InstantiateCoSimulation("a", "{other}", "", false, true, false, false, NULL, 0U, &message_of, keep, NULL) == NULL);
    NEED(strstr(message_of.text, "token") != NULL);
    NEED(fmi3InstantiateModelExchange("a", token, "", false, true, &message_of, keep) == NULL);
    NEED(strstr(message_of.text, "co-simulation") != NULL);
    NEED(fmi3InstantiateCoSimulation("a", token, "", false, true, true, false, NULL, 0U, &message_of, keep, NULL) == NULL);
    fmu = fmi3InstantiateCoSimulation("a", token, "", false, true, false, false, NULL, 0U, &message_of, keep, NULL);
    NEED(fmu != NULL);

    /* Calls out of order, and what this FMU does not have. */
    NEED(step(fmu, 0.0, 1e-3) == ERROR && strstr(message_of.text, "initialization") != NULL);
    NEED(fmi3EnterInitializationMode(fmu, false, 0.0, 0.0, false, 0.0) == OK);
    NEED(fmi3EnterInitializationMode(fmu, false, 0.0, 0.0, false, 0.0) == ERROR);
    NEED(has_force(fmu, &force) == OK && force != force);
    NEED(fmi3ExitInitializationMode(fmu) == OK && fmi3EnterStepMode(fmu) == ERROR);
    NEED(fmi3GetInt32(fmu, &flags, 1U, (int32_t[1]){ 0 }, 1U) == ERROR && strstr(message_of.text, "fmi3GetInt32") != NULL);
    NEED(fmi3SetBoolean(fmu, truths, 1U, (const bool[1]){ true }, 1U) == ERROR);
    NEED(fmi3EnterConfigurationMode(fmu) == ERROR);
    NEED(fmi3SetDebugLogging(fmu, true, 1U, &other_category) == OK);
    message_of.text[0] = '\0';
    NEED(step(fmu, 0.0, 0.0) == ERROR && message_of.text[0] == '\0');
    NEED(fmi3SetDebugLogging(fmu, true, 1U, &own_category) == OK);
    NEED(step(fmu, 0.0, -1.0) == ERROR && strstr(message_of.text, "step size") != NULL);
    NEED(step(fmu, 1e12, 1.0) == ERROR && strstr(message_of.text, "9e9") != NULL);
    NEED(fmi3GetFloat64(fmu, &flags, 1U, &value, 1U) == ERROR && strstr(message_of.text, "reference 15") != NULL);
    NEED(fmi3SetFloat64(fmu, estimates, 1U, &value, 1U) == ERROR);
    NEED(fmi3GetFloat64(fmu, estimates, 2U, &value, 1U) == ERROR && fmi3GetFloat64(fmu, estimates, 1U, given, 2U) == ERROR);

    /* A parameter is a finite number. It may be changed, and reset sets it back. */
    NEED(fmi3GetFloat64(fmu, &parameter, 1U, &value, 1U) == OK);
    nan = force;
    NEED(fmi3SetFloat64(fmu, &parameter, 1U, &nan, 1U) == ERROR && strstr(message_of.text, "finite") != NULL);
    NEED(fmi3GetFloat64(fmu, &parameter, 1U, &again, 1U) == OK && again == value);
    again = value + 1.0;
    NEED(fmi3SetFloat64(fmu, &parameter, 1U, &again, 1U) == OK);
    NEED(fmi3GetFloat64(fmu, &parameter, 1U, &force, 1U) == OK && force == value + 1.0);
    NEED(fmi3Reset(fmu) == OK && fmi3GetFloat64(fmu, &parameter, 1U, &again, 1U) == OK && again == value);
    NEED(fmi3EnterInitializationMode(fmu, false, 0.0, 0.0, false, 0.0) == OK && fmi3ExitInitializationMode(fmu) == OK);

    for (k = 3U; k < (size_t)count && n < 5U && strchr(arguments[k], '=') == NULL; k++) {
        inputs[n] = (uint32_t)strtoul(arguments[k], NULL, 10);
        channels[n] = inputs[n] - 1U;
        has_inverse = has_inverse || inputs[n] == 5U;
        n++;
    }
    /* Without an inverse controller there is no such output. */
    NEED(has_inverse == (current_of(fmu) >= 0.0));
    /* In FMI 3.0 the achievable range is one array. */
    NEED(fmi3GetFloat64(fmu, (const uint32_t[1]){ 25U }, 1U, &again, 1U) == ERROR);
    if (has_inverse) {
        /* Before the first step the current is the safe one within the limits, also if these are changed. */
        const uint32_t safe = named(count, arguments, "safe="), most = named(count, arguments, "most=");
        const double safe_a = 0.7, most_a = 0.4, negative_a = -1.0;
        NEED(fmi3SetFloat64(fmu, &safe, 1U, &safe_a, 1U) == OK && current_of(fmu) == safe_a);
        NEED(fmi3SetFloat64(fmu, &most, 1U, &most_a, 1U) == OK && current_of(fmu) == most_a);
        NEED(fmi3SetFloat64(fmu, &most, 1U, &negative_a, 1U) == ERROR && strstr(message_of.text, "min") != NULL);
        NEED(current_of(fmu) == most_a && fmi3Reset(fmu) == OK && current_of(fmu) >= 0.0);
        NEED(fmi3EnterInitializationMode(fmu, false, 0.0, 0.0, false, 0.0) == OK && fmi3ExitInitializationMode(fmu) == OK);
    }
    while (fread(&time_ns, sizeof time_ns, 1, stdin) == 1 && fread(given, sizeof given, 1, stdin) == 1) {
        double values[5], numbers[2];
        uint32_t found;
        bool is_true[2];
        for (k = 0U; k < n; k++) {
            values[k] = given[channels[k]];
        }
        NEED(fmi3SetFloat64(fmu, inputs, n, values, n) == OK);
        NEED(step(fmu, (double)time_ns * 1e-9, 1e-3) == OK);
        NEED(fmi3GetFloat64(fmu, estimates, 2U, numbers, 2U) == OK);
        NEED(fmi3GetUInt32(fmu, &flags, 1U, &found, 1U) == OK);
        NEED(fmi3GetBoolean(fmu, truths, 2U, is_true, 2U) == OK);
        NEED(is_true[0] == (numbers[0] == numbers[0]));
        write_estimate(is_true[1], found, numbers);
        NEED(!has_inverse || get_command(fmu) == OK);
    }

    /* Time does not go back without a state; from a state, and from its bytes, the same step gives the same force. */
    NEED(step(fmu, (double)time_ns * 1e-9, 1e-3) == ERROR && strstr(message_of.text, "1 ns later") != NULL);
    NEED(fmi3GetFMUState(fmu, &state) == OK && fmi3SerializedFMUStateSize(fmu, state, &size) == OK);
    bytes = malloc(size);
    NEED(bytes != NULL && fmi3SerializeFMUState(fmu, state, bytes, size) == OK);
    NEED(fmi3SerializeFMUState(fmu, state, bytes, size - 1U) == ERROR);
    value = 1e-3;
    NEED(fmi3SetFloat64(fmu, &displacement, 1U, &value, 1U) == OK);
    NEED(step(fmu, (double)time_ns * 1e-9 + 1e-3, 1e-3) == OK && has_force(fmu, &force) == OK);
    NEED(fmi3SetFMUState(fmu, state) == OK && fmi3SetFloat64(fmu, &displacement, 1U, &value, 1U) == OK);
    NEED(step(fmu, (double)time_ns * 1e-9 + 1e-3, 1e-3) == OK && has_force(fmu, &again) == OK);
    NEED(memcmp(&force, &again, sizeof force) == 0);
    NEED(fmi3DeserializeFMUState(fmu, bytes, size, &copy) == OK && fmi3SetFMUState(fmu, copy) == OK);
    NEED(fmi3SetFloat64(fmu, &displacement, 1U, &value, 1U) == OK);
    NEED(step(fmu, (double)time_ns * 1e-9 + 1e-3, 1e-3) == OK && has_force(fmu, &again) == OK);
    NEED(memcmp(&force, &again, sizeof force) == 0);
    bytes[3] ^= 1U;
    NEED(fmi3DeserializeFMUState(fmu, bytes, size, &copy) == ERROR && fmi3DeserializeFMUState(fmu, bytes, 3U, &copy) == ERROR);
    NEED(fmi3FreeFMUState(fmu, &state) == OK && fmi3FreeFMUState(fmu, &copy) == OK && state == NULL && copy == NULL);
    if (has_inverse) {
        /* In a long silence the current reaches the safe one. */
        const uint32_t safe = named(count, arguments, "safe="), most = named(count, arguments, "most="), request = 5U;
        const double safe_a = 0.8, most_a = 0.4, from_s = (double)time_ns * 1e-9 + 20.0, zero = 0.0;
        NEED(fmi3SetFloat64(fmu, &safe, 1U, &safe_a, 1U) == OK && fmi3SetFloat64(fmu, &request, 1U, &nan, 1U) == OK);
        NEED(fmi3SetFloat64(fmu, &displacement, 1U, &nan, 1U) == OK && step(fmu, from_s, 1e-3) == OK);
        NEED(current_of(fmu) > safe_a - 1e-9 && current_of(fmu) < safe_a + 1e-9);
        NEED(fmi3SetFloat64(fmu, &displacement, 1U, &value, 1U) == OK && step(fmu, from_s + 1e-3, 1e-3) == OK);
        NEED(current_of(fmu) > safe_a - 1e-9 && current_of(fmu) < safe_a + 1e-9);
        /* A largest current that is lowered holds at the next step, without a displacement and with one. */
        NEED(fmi3SetFloat64(fmu, &most, 1U, &most_a, 1U) == OK);
        NEED(fmi3SetFloat64(fmu, &displacement, 1U, &nan, 1U) == OK && step(fmu, from_s + 2e-3, 1e-3) == OK);
        NEED(current_of(fmu) == most_a);
        NEED(fmi3SetFloat64(fmu, &displacement, 1U, &value, 1U) == OK && fmi3SetFloat64(fmu, &request, 1U, &zero, 1U) == OK);
        NEED(step(fmu, from_s + 3e-3, 1e-3) == OK && current_of(fmu) >= 0.0 && current_of(fmu) <= most_a);
    }
    NEED(fmi3Terminate(fmu) == OK && fmi3Terminate(fmu) == ERROR);
    NEED(fmi3SetFloat64(fmu, &displacement, 1U, &value, 1U) == ERROR && step(fmu, 1e6, 1.0) == ERROR);
    free(bytes);
    fmi3FreeInstance(fmu);
    fmi3FreeInstance(NULL);
    return 0;
}
