/* What the importers of FMI 2.0 and FMI 3.0 share: their arguments, what they demand, and what they write. */
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The status codes that both versions have. */
#define OK 0
#define ERROR 3

/* Ends the program with the last message if the condition is false. */
#define NEED(condition)                                                                                                          \
    if (!(condition)) {                                                                                                          \
        fprintf(stderr, "line %d: %s; last message: %s\n", __LINE__, #condition, message_of.text);                                \
        return 1;                                                                                                                \
    }

typedef struct {
    char text[300];
} last_message;

/* The value reference in the argument that begins with `name`; 0 without one. */
static uint32_t named(int count, char **arguments, const char *name) {
    int k;
    for (k = 3; k < count; k++) {
        if (strncmp(arguments[k], name, strlen(name)) == 0) {
            return (uint32_t)strtoul(arguments[k] + strlen(name), NULL, 10);
        }
    }
    return 0U;
}

/* The estimate of a step: force and expected reading. */
static void write_estimate(bool is_accepted, uint32_t flags, const double numbers[2]) {
    const uint32_t words[2] = { is_accepted ? 1U : 0U, flags };
    fwrite(words, sizeof words, 1, stdout);
    fwrite(numbers, sizeof *numbers, 2, stdout);
}

/* The command of a step: current, demanded and expected force, achievable range; whether it is a command, achievable, dissipative. */
static void write_command(const double numbers[5], uint32_t limited_by, const bool truths[3]) {
    const uint32_t words[2] = { limited_by, (truths[0] ? 1U : 0U) | (truths[1] ? 2U : 0U) | (truths[2] ? 4U : 0U) };
    fwrite(words, sizeof words, 1, stdout);
    fwrite(numbers, sizeof *numbers, 5, stdout);
}
