/* A host that is no Python: host STEP STEPS INPUT VALUE OUTPUTS [LIBRARY GUID RESOURCES]...

An instance of each library, all with the same value of an input, makes its steps in a thread of its own. Prints a line
of outputs a step, one instance after the other, as hexadecimal doubles, so that bits can be compared; what instances
log; and what became of the process: how it takes an interrupt, and its PYTHONPATH. Variables are value references,
OUTPUTS with commas between. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <pthread.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MOST 1000

typedef struct {
    void (*log)(void *, const char *, int, const char *, const char *, ...);
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void *finished, *environment;
} Callbacks;

typedef struct {
    void *library, *instance;
    double told[MOST];
    int failed;
} Part;

static double step, value;
static int steps, count;
static unsigned input, outputs[16];

static void say(void *environment, const char *name, int status, const char *category, const char *text, ...) {
    va_list more;
    (void)environment;
    va_start(more, text);
    printf("log %s %d %s: ", name, status, category);
    vprintf(text, more);
    printf("\n");
    va_end(more);
}

static void *of(const Part *part, const char *name) {
    void *function = dlsym(part->library, name);
    if (!function) { printf("no %s\n", name); exit(3); }
    return function;
}

static void *run(void *given) {
    Part *part = given;
    int (*set)(void *, const unsigned *, size_t, const double *) = of(part, "fmi2SetReal");
    int (*get)(void *, const unsigned *, size_t, double *) = of(part, "fmi2GetReal");
    int (*setup)(void *, int, double, double, int, double) = of(part, "fmi2SetupExperiment");
    int (*enter)(void *) = of(part, "fmi2EnterInitializationMode");
    int (*leave)(void *) = of(part, "fmi2ExitInitializationMode");
    int (*advance)(void *, double, double, int) = of(part, "fmi2DoStep");
    int (*terminate)(void *) = of(part, "fmi2Terminate");
    void *instance = part->instance;
    part->failed = setup(instance, 0, 0.0, 0.0, 0, 0.0) | enter(instance) | set(instance, &input, 1, &value)
        | leave(instance);
    for (int i = 0; !part->failed && i < steps; i++)
        part->failed = advance(instance, i * step, step, 1)
            | get(instance, outputs, (size_t)count, part->told + i * count);
    part->failed |= terminate(instance);
    return NULL;
}

int main(int given, char **words) {
    if (given < 9) return 2;
    struct sigaction before, after;
    sigaction(SIGINT, NULL, &before);
    step = atof(words[1]), steps = atoi(words[2]), input = (unsigned)atoi(words[3]), value = atof(words[4]);
    for (char *word = strtok(words[5], ","); word; word = strtok(NULL, ",")) outputs[count++] = (unsigned)atoi(word);
    if (steps * count > MOST) return 2;
    Callbacks callbacks = {say, calloc, free, NULL, NULL};
    int parts = (given - 6) / 3, failed = 0;
    Part *all = calloc((size_t)parts, sizeof *all);
    for (int i = 0; i < parts; i++) {
        Part *part = all + i;
        part->library = dlopen(words[6 + 3 * i], RTLD_NOW | RTLD_LOCAL);
        if (!part->library) { printf("%s\n", dlerror()); return 3; }
        const char *(*version)(void) = of(part, "fmi2GetVersion");
        void *(*instantiate)(const char *, int, const char *, const char *, const Callbacks *, int, int) =
            of(part, "fmi2Instantiate");
        void (*release)(void *) = of(part, "fmi2FreeInstance");
        printf("version %s\n", version());
        part->instance = instantiate("there", 1, words[7 + 3 * i], words[8 + 3 * i], &callbacks, 0, 0);
        if (!part->instance) {
            release(NULL);  /* FMI allows that */
            printf("no instance\n");
            return 1;
        }
    }
    pthread_t threads[8];
    for (int i = 0; i < parts; i++) pthread_create(threads + i, NULL, run, all + i);
    for (int i = 0; i < parts; i++) pthread_join(threads[i], NULL);
    for (int i = 0; i < parts; i++) {
        Part *part = all + i;
        for (int j = 0; j < steps; j++, printf("\n"))
            for (int k = 0; k < count; k++) printf("%a ", part->told[j * count + k]);
        void (*release)(void *) = of(part, "fmi2FreeInstance");
        release(part->instance);
        dlclose(part->library);
        failed |= part->failed;
    }
    sigaction(SIGINT, NULL, &after);
    printf("interrupt %s\n", after.sa_handler == before.sa_handler ? "as it was" : "handled");
    printf("path %s\n", getenv("PYTHONPATH") ? getenv("PYTHONPATH") : "none");
    free(all);
    return failed;
}
