/* An FMU in C that holds its host to the standard: what is called in a wrong state is refused and logged.
   It keeps what it is given: real u, integers n and mode; real y = k u, integer shown = mode. */
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

enum { INSTANTIATED, INITIALIZING, RUNNING, TERMINATED, FAILED };

typedef struct {
    const fmi2CallbackFunctions *callbacks;
    char name[64];
    int state, n, mode;
    double u, k, y;
} Strict;

static fmi2Status refused(Strict *own, const char *why) {
    own->callbacks->logger(own->callbacks->componentEnvironment, own->name, fmi2Error, "logStatusError", why);
    return fmi2Error;
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
    (void)type; (void)guid; (void)resources; (void)visible; (void)logging;
    Strict *own = calloc(1, sizeof *own);
    own->callbacks = callbacks;
    strncpy(own->name, name, sizeof own->name - 1);
    own->k = 1.0;
    own->n = own->mode = 1;
    return own;
}

void fmi2FreeInstance(fmi2Component c) { free(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean given, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stops, fmi2Real stop) {
    (void)given; (void)tolerance; (void)start; (void)stops; (void)stop;
    return ((Strict *)c)->state == INSTANTIATED ? fmi2OK : refused(c, "fmi2SetupExperiment in a wrong state");
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    Strict *own = c;
    if (own->state != INSTANTIATED) return refused(own, "fmi2EnterInitializationMode in a wrong state");
    own->state = INITIALIZING;
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    Strict *own = c;
    if (own->state != INITIALIZING) return refused(own, "fmi2ExitInitializationMode in a wrong state");
    own->state = own->k < 0.0 ? FAILED : RUNNING;
    return own->state == RUNNING ? fmi2OK : refused(own, "k must not be negative");
}

fmi2Status fmi2Terminate(fmi2Component c) {
    Strict *own = c;
    if (own->state != RUNNING) return refused(own, "fmi2Terminate in a wrong state");
    own->state = TERMINATED;
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean no_way_back) {
    (void)time; (void)step; (void)no_way_back;
    Strict *own = c;
    if (own->state != RUNNING) return refused(own, "fmi2DoStep in a wrong state");
    if (own->u > 900.0) {
        own->state = FAILED;
        return refused(own, "u is above 900");
    }
    own->y = own->k * own->u;
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference which[], size_t count, const fmi2Real values[]) {
    Strict *own = c;
    for (size_t i = 0; i < count; i++) {
        if (which[i] == 2 && values[i] > 1000.0) {
            own->state = FAILED;
            return refused(own, "k is above 1000");
        }
        *(which[i] == 0 ? &own->u : &own->k) = values[i];
    }
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference which[], size_t count, fmi2Real values[]) {
    Strict *own = c;
    for (size_t i = 0; i < count; i++) values[i] = which[i] == 0 ? own->u : which[i] == 1 ? own->y : own->k;
    return fmi2OK;
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference which[], size_t count, const fmi2Integer values[]) {
    Strict *own = c;
    for (size_t i = 0; i < count; i++) *(which[i] == 10 ? &own->n : &own->mode) = values[i];
    return fmi2OK;
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference which[], size_t count, fmi2Integer values[]) {
    Strict *own = c;
    for (size_t i = 0; i < count; i++) values[i] = which[i] == 10 ? own->n : own->mode;
    return fmi2OK;
}
