/* An importer of an FMI 2.0 FMU for co-simulation, linked to its sources. Its arguments are the GUID, the value
   reference of a parameter, and the value references of the inputs among the readings; with the fifth one, the FMU has an inverse
   controller. It reads readings, and writes what the FMU gives.
   Types and prototypes are written after the standard, independently of the FMU. */
#include "importer.h"

typedef struct {
    void (*logger)(void *environment, const char *name, int status, const char *category, const char *message, ...);
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, int);
    void *environment;
} callbacks;
const char *fmi2GetVersion(void);
const char *fmi2GetTypesPlatform(void);
void *fmi2Instantiate(const char *, int type, const char *, const char *, const callbacks *, int, int);
void fmi2FreeInstance(void *);
int fmi2SetDebugLogging(void *, int, size_t, const char *const[]);
int fmi2SetupExperiment(void *, int, double, double, int, double);
int fmi2EnterInitializationMode(void *);
int fmi2ExitInitializationMode(void *);
int fmi2Terminate(void *);
int fmi2Reset(void *);
int fmi2SetReal(void *, const unsigned[], size_t, const double[]);
int fmi2GetReal(void *, const unsigned[], size_t, double[]);
int fmi2GetInteger(void *, const unsigned[], size_t, int[]);
int fmi2SetInteger(void *, const unsigned[], size_t, const int[]);
int fmi2GetBoolean(void *, const unsigned[], size_t, int[]);
int fmi2GetString(void *, const unsigned[], size_t, const char *[]);
int fmi2GetFMUstate(void *, void **);
int fmi2SetFMUstate(void *, void *);
int fmi2FreeFMUstate(void *, void **);
int fmi2SerializedFMUstateSize(void *, void *, size_t *);
int fmi2SerializeFMUstate(void *, void *, char[], size_t);
int fmi2DeSerializeFMUstate(void *, const char[], size_t, void **);
int fmi2DoStep(void *, double, double, int);
int fmi2CancelStep(void *);
int fmi2GetStatus(void *, int, int *);
int fmi2GetRealStatus(void *, int, double *);
int fmi2GetBooleanStatus(void *, int, int *);

#define DISCARD 2

static void keep(void *environment, const char *name, int status, const char *category, const char *message, ...) {
    last_message *last = environment;
    if (status == ERROR && strcmp(name, "a") == 0 && strcmp(category, "logStatusError") == 0) {
        (void)snprintf(last->text, sizeof last->text, "%s", message);
    }
}

static int step(void *fmu, double time_s, double step_s) {
    return fmi2DoStep(fmu, time_s, step_s, 1);
}

static int has_force(void *fmu, double *force) {
    const unsigned which = 11U;
    return fmi2GetReal(fmu, &which, 1U, force);
}

/* Writes the command after a step. */
static int get_command(void *fmu) {
    const unsigned forces[5] = { 21U, 22U, 23U, 24U, 25U }, limited_by = 26U, which[3] = { 27U, 28U, 29U };
    double numbers[5];
    int limit = -1, is_true[3];
    bool truths[3];
    size_t k;
    if (fmi2GetReal(fmu, forces, 5U, numbers) != OK || fmi2GetInteger(fmu, &limited_by, 1U, &limit) != OK || limit < 0
        || fmi2GetBoolean(fmu, which, 3U, is_true) != OK) {
        return ERROR;
    }
    for (k = 0U; k < 3U; k++) {
        truths[k] = is_true[k] != 0;
    }
    write_command(numbers, (uint32_t)limit, truths);
    return OK;
}

/* The commanded current, NaN if it cannot be read. */
static double current_of(void *fmu) {
    const unsigned current = 21U;
    double value = 0.0;
    return fmi2GetReal(fmu, &current, 1U, &value) == OK ? value : 0.0 / value;
}

int main(int count, char **arguments) {
    static last_message message_of;
    const callbacks calls = { keep, calloc, free, NULL, &message_of };
    const char *token = count > 2 ? arguments[1] : "";
    const unsigned parameter = count > 2 ? (unsigned)strtoul(arguments[2], NULL, 10) : 0U;
    const unsigned estimates[2] = { 11U, 12U }, flags = 15U, truths[2] = { 16U, 17U }, displacement = 1U;
    unsigned inputs[5];
    bool has_inverse = false;
    size_t channels[5], k, n = 0U, size = 0U;
    const char *own_category = "logStatusError", *other_category = "logEvents";
    void *fmu, *state = NULL, *copy = NULL;
    char *bytes;
    int status = 1;
    int64_t time_ns;
    double given[5], force = 0.0, again = 0.0, value = 0.0, nan;

    NEED(strcmp(fmi2GetVersion(), "2.0") == 0 && strcmp(fmi2GetTypesPlatform(), "default") == 0);
    NEED(fmi2Instantiate("a", 1, "{other}", "", &calls, 0, 1) == NULL && strstr(message_of.text, "GUID") != NULL);
    message_of.text[0] = '\0';
    NEED(fmi2Instantiate("a", 0, token, "", &calls, 0, 1) == NULL && strstr(message_of.text, "co-simulation") != NULL);
    fmu = fmi2Instantiate("a", 1, token, "", &calls, 0, 1);
    NEED(fmu != NULL);

    /* Calls out of order, and what this FMU does not have. */
    NEED(step(fmu, 0.0, 1e-3) == ERROR && strstr(message_of.text, "initialization") != NULL);
    NEED(fmi2SetupExperiment(fmu, 0, 0.0, 2.0, 0, 0.0) == OK && fmi2EnterInitializationMode(fmu) == OK);
    NEED(fmi2EnterInitializationMode(fmu) == ERROR);
    NEED(has_force(fmu, &force) == OK && force != force);
    NEED(fmi2ExitInitializationMode(fmu) == OK && fmi2SetupExperiment(fmu, 0, 0.0, 0.0, 0, 0.0) == ERROR);
    NEED(fmi2GetString(fmu, &flags, 1U, &own_category) == ERROR && strstr(message_of.text, "fmi2GetString") != NULL);
    NEED(fmi2SetInteger(fmu, &flags, 1U, (const int[1]){ 0 }) == ERROR && fmi2CancelStep(fmu) == ERROR);
    NEED(fmi2GetStatus(fmu, 0, &status) == DISCARD && fmi2GetBooleanStatus(fmu, 3, &status) == OK && status == 0);
    NEED(fmi2GetRealStatus(fmu, 2, &value) == OK && value == 2.0 && fmi2GetRealStatus(fmu, 0, &value) == DISCARD);
    NEED(fmi2SetDebugLogging(fmu, 1, 1U, &other_category) == OK);
    message_of.text[0] = '\0';
    NEED(step(fmu, 0.0, 0.0) == ERROR && message_of.text[0] == '\0');
    NEED(fmi2SetDebugLogging(fmu, 1, 1U, &own_category) == OK);
    NEED(step(fmu, 0.0, -1.0) == ERROR && strstr(message_of.text, "step size") != NULL);
    NEED(step(fmu, 1e12, 1.0) == ERROR && strstr(message_of.text, "9e9") != NULL);
    NEED(fmi2GetReal(fmu, &flags, 1U, &value) == ERROR && strstr(message_of.text, "reference 15") != NULL);
    NEED(fmi2SetReal(fmu, estimates, 1U, &value) == ERROR);

    /* A parameter is a finite number. It may be changed, and reset sets it back. */
    NEED(fmi2GetReal(fmu, &parameter, 1U, &value) == OK);
    nan = force;
    NEED(fmi2SetReal(fmu, &parameter, 1U, &nan) == ERROR && strstr(message_of.text, "finite") != NULL);
    NEED(fmi2GetReal(fmu, &parameter, 1U, &again) == OK && again == value);
    again = value + 1.0;
    NEED(fmi2SetReal(fmu, &parameter, 1U, &again) == OK);
    NEED(fmi2GetReal(fmu, &parameter, 1U, &force) == OK && force == value + 1.0);
    NEED(fmi2Reset(fmu) == OK && fmi2GetReal(fmu, &parameter, 1U, &again) == OK && again == value);
    NEED(fmi2EnterInitializationMode(fmu) == OK && fmi2ExitInitializationMode(fmu) == OK);

    for (k = 3U; k < (size_t)count && n < 5U && strchr(arguments[k], '=') == NULL; k++) {
        inputs[n] = (unsigned)strtoul(arguments[k], NULL, 10);
        channels[n] = inputs[n] - 1U;
        has_inverse = has_inverse || inputs[n] == 5U;
        n++;
    }
    /* Without an inverse controller there is no such output. */
    NEED(has_inverse == (current_of(fmu) >= 0.0));
    if (has_inverse) {
        /* Before the first step the current is the safe one within the limits, also if these are changed. */
        const unsigned safe = named(count, arguments, "safe="), most = named(count, arguments, "most=");
        const double safe_a = 0.7, most_a = 0.4, negative_a = -1.0;
        NEED(fmi2SetReal(fmu, &safe, 1U, &safe_a) == OK && current_of(fmu) == safe_a);
        NEED(fmi2SetReal(fmu, &most, 1U, &most_a) == OK && current_of(fmu) == most_a);
        NEED(fmi2SetReal(fmu, &most, 1U, &negative_a) == ERROR && strstr(message_of.text, "min") != NULL);
        NEED(current_of(fmu) == most_a && fmi2Reset(fmu) == OK && current_of(fmu) >= 0.0);
        NEED(fmi2EnterInitializationMode(fmu) == OK && fmi2ExitInitializationMode(fmu) == OK);
    }
    while (fread(&time_ns, sizeof time_ns, 1, stdin) == 1 && fread(given, sizeof given, 1, stdin) == 1) {
        double values[5], numbers[2];
        int is_true[2], found;
        for (k = 0U; k < n; k++) {
            values[k] = given[channels[k]];
        }
        NEED(fmi2SetReal(fmu, inputs, n, values) == OK);
        NEED(step(fmu, (double)time_ns * 1e-9, 1e-3) == OK);
        NEED(fmi2GetReal(fmu, estimates, 2U, numbers) == OK);
        NEED(fmi2GetInteger(fmu, &flags, 1U, &found) == OK);
        NEED(fmi2GetBoolean(fmu, truths, 2U, is_true) == OK);
        NEED((is_true[0] != 0) == (numbers[0] == numbers[0]));
        write_estimate(is_true[1] != 0, (uint32_t)found, numbers);
        NEED(!has_inverse || get_command(fmu) == OK);
    }

    /* Time does not go back without a state; from a state, and from its bytes, the same step gives the same force. */
    NEED(step(fmu, (double)time_ns * 1e-9, 1e-3) == ERROR && strstr(message_of.text, "1 ns later") != NULL);
    NEED(fmi2GetFMUstate(fmu, &state) == OK && fmi2SerializedFMUstateSize(fmu, state, &size) == OK);
    bytes = malloc(size);
    NEED(bytes != NULL && fmi2SerializeFMUstate(fmu, state, bytes, size) == OK);
    NEED(fmi2SerializeFMUstate(fmu, state, bytes, size - 1U) == ERROR);
    value = 1e-3;
    NEED(fmi2SetReal(fmu, &displacement, 1U, &value) == OK);
    NEED(step(fmu, (double)time_ns * 1e-9 + 1e-3, 1e-3) == OK && has_force(fmu, &force) == OK);
    NEED(fmi2SetFMUstate(fmu, state) == OK && fmi2SetReal(fmu, &displacement, 1U, &value) == OK);
    NEED(step(fmu, (double)time_ns * 1e-9 + 1e-3, 1e-3) == OK && has_force(fmu, &again) == OK);
    NEED(memcmp(&force, &again, sizeof force) == 0);
    NEED(fmi2DeSerializeFMUstate(fmu, bytes, size, &copy) == OK && fmi2SetFMUstate(fmu, copy) == OK);
    NEED(fmi2SetReal(fmu, &displacement, 1U, &value) == OK);
    NEED(step(fmu, (double)time_ns * 1e-9 + 1e-3, 1e-3) == OK && has_force(fmu, &again) == OK);
    NEED(memcmp(&force, &again, sizeof force) == 0);
    bytes[3] = (char)(bytes[3] + 1);
    NEED(fmi2DeSerializeFMUstate(fmu, bytes, size, &copy) == ERROR && fmi2DeSerializeFMUstate(fmu, bytes, 3U, &copy) == ERROR);
    NEED(fmi2FreeFMUstate(fmu, &state) == OK && fmi2FreeFMUstate(fmu, &copy) == OK && state == NULL && copy == NULL);
    if (has_inverse) {
        /* In a long silence the current reaches the safe one. */
        const unsigned safe = named(count, arguments, "safe="), most = named(count, arguments, "most="), request = 5U;
        const double safe_a = 0.8, most_a = 0.4, from_s = (double)time_ns * 1e-9 + 20.0, zero = 0.0;
        NEED(fmi2SetReal(fmu, &safe, 1U, &safe_a) == OK && fmi2SetReal(fmu, &request, 1U, &nan) == OK);
        NEED(fmi2SetReal(fmu, &displacement, 1U, &nan) == OK && step(fmu, from_s, 1e-3) == OK);
        NEED(current_of(fmu) > safe_a - 1e-9 && current_of(fmu) < safe_a + 1e-9);
        NEED(fmi2SetReal(fmu, &displacement, 1U, &value) == OK && step(fmu, from_s + 1e-3, 1e-3) == OK);
        NEED(current_of(fmu) > safe_a - 1e-9 && current_of(fmu) < safe_a + 1e-9);
        /* A largest current that is lowered holds at the next step, without a displacement and with one. */
        NEED(fmi2SetReal(fmu, &most, 1U, &most_a) == OK);
        NEED(fmi2SetReal(fmu, &displacement, 1U, &nan) == OK && step(fmu, from_s + 2e-3, 1e-3) == OK);
        NEED(current_of(fmu) == most_a);
        NEED(fmi2SetReal(fmu, &displacement, 1U, &value) == OK && fmi2SetReal(fmu, &request, 1U, &zero) == OK);
        NEED(step(fmu, from_s + 3e-3, 1e-3) == OK && current_of(fmu) >= 0.0 && current_of(fmu) <= most_a);
    }
    NEED(fmi2Terminate(fmu) == OK && fmi2Terminate(fmu) == ERROR);
    NEED(fmi2SetReal(fmu, &displacement, 1U, &value) == ERROR && step(fmu, 1e6, 1.0) == ERROR);
    free(bytes);
    fmi2FreeInstance(fmu);
    fmi2FreeInstance(NULL);
    return 0;
}
