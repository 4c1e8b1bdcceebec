/* The library a host loads on Linux: brings Python into a process that has none, then lets PythonFMU's do the work.

PythonFMU's library takes Python's functions from the process it is loaded into, so a host that is no Python cannot load
it. This one loads without. When the first instance is asked for it looks for a Python in the process, else asks the
program `python3` on PATH, or what FMU_PYTHON names, for its shared library and its modules and starts that; all calls
then go to PythonFMU's library beside this one. Where there is no Python the instance is refused, and the log says why.

A Python that is started here leaves the host its signals and its environment, and lives as long as the process. The
first instances of a process have to be made one after the other, as hosts do.
*/

#define _GNU_SOURCE
#include <ctype.h>
#include <dlfcn.h>
#include <limits.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define BEHIND "libpythonfmu-export.so"
#define MOST 65536 /* letters of a line that is read */

typedef void *(*Instantiate)(const char *, int, const char *, const char *, const void *, int, int);
typedef struct { /* fmi2CallbackFunctions, as far as it is used */
    void (*log)(void *, const char *, int, const char *, const char *, ...);
    void *allocate, *release, *finished, *environment;
} Callbacks;
enum { ERROR = 3 };

/* The functions that go straight through. */
#define FUNCTIONS(X) \
    X(fmi2FreeInstance) X(fmi2SetDebugLogging) X(fmi2SetupExperiment) X(fmi2EnterInitializationMode) \
    X(fmi2ExitInitializationMode) X(fmi2Terminate) X(fmi2Reset) X(fmi2GetReal) X(fmi2GetInteger) X(fmi2GetBoolean) \
    X(fmi2GetString) X(fmi2SetReal) X(fmi2SetInteger) X(fmi2SetBoolean) X(fmi2SetString) X(fmi2GetFMUstate) \
    X(fmi2SetFMUstate) X(fmi2FreeFMUstate) X(fmi2SerializedFMUstateSize) X(fmi2SerializeFMUstate) \
    X(fmi2DeSerializeFMUstate) X(fmi2GetDirectionalDerivative) X(fmi2SetRealInputDerivatives) \
    X(fmi2GetRealOutputDerivatives) X(fmi2DoStep) X(fmi2CancelStep) X(fmi2GetStatus) X(fmi2GetRealStatus) \
    X(fmi2GetIntegerStatus) X(fmi2GetBooleanStatus) X(fmi2GetStringStatus)

/* Until an instance could be made there is none to call anything of. */
static int refused(void) { return ERROR; }

/* Each jumps where its pointer says with all arguments as they came, so their types need not be known here. */
#define THROUGH(name) \
    __attribute__((visibility("hidden"))) void *to_##name = (void *)refused; \
    __attribute__((naked, visibility("default"))) void name(void) { __asm__("jmpq *to_" #name "(%rip)"); }
FUNCTIONS(THROUGH)

static void *library;
static Instantiate instantiate;

__attribute__((visibility("default"))) const char *fmi2GetTypesPlatform(void) { return "default"; }
__attribute__((visibility("default"))) const char *fmi2GetVersion(void) { return "2.0"; }

/* What the program says of itself: its shared library, where it is installed, where its modules are; a line each. */
static const char ASK[] =
    " -c 'import os, sys, sysconfig\n"
    "name = sysconfig.get_config_var(\"INSTSONAME\") or \"\"\n"
    "places = [sysconfig.get_config_var(\"LIBDIR\") or \"\", os.path.join(sys.base_prefix, \"lib\")]\n"
    "paths = [os.path.join(place, name) for place in places]\n"
    "print(next(filter(os.path.isfile, paths), paths[0]))\n"
    "print(sys.base_prefix)\n"
    "print(os.pathsep.join(path for path in sys.path if path))' 2>/dev/null";

/* The next line without its end; whether there is one. */
static int line(FILE *stream, char *text) {
    if (!fgets(text, MOST, stream)) return 0;
    text[strcspn(text, "\n")] = 0;
    return 1;
}

/* Set a variable of the environment, or take it away; returns a copy of what it was. */
static char *exchanged(const char *name, const char *value) {
    const char *now = getenv(name);
    char *before = now ? strdup(now) : NULL;
    if (value) setenv(name, value, 1); else unsetenv(name);
    return before;
}

/* Load the shared library of a Python that is installed. Returns why not, NULL where it is there. */
static const char *bring_python(char *home, char *modules) {
    static char why[2 * MOST], command[MOST], file[MOST];
    const char *program = getenv("FMU_PYTHON");
    if (!program || !*program) program = "python3";
    snprintf(command, sizeof command, "\"%s\"%s", program, ASK);
    FILE *told = popen(command, "r");
    int whole = told && line(told, file) && line(told, home) && line(told, modules);
    if (told) pclose(told);
    if (!whole) {
        snprintf(why, sizeof why, "this FMU runs in Python, which this program is not, and there is no program '%s': "
                 "put a python3 with numpy on PATH, or name one in FMU_PYTHON", program);
        return why;
    }
    if (!dlopen(file, RTLD_NOW | RTLD_GLOBAL)) {
        snprintf(why, sizeof why, "this FMU runs in Python, which this program is not, and '%s' has no shared library "
                 "to bring (%s): install it, or name another Python in FMU_PYTHON", program, dlerror());
        return why;
    }
    return NULL;
}

/* Python's functions that are used here, from wherever the process has them. */
#define PYTHON(X) \
    X(int, Py_IsInitialized, void) X(void, Py_InitializeEx, int) X(void *, PyEval_SaveThread, void) \
    X(int, PyGILState_Ensure, void) X(void, PyGILState_Release, int) X(void *, PyImport_ImportModule, const char *) \
    X(void, PyErr_Clear, void)
#define DECLARE(result, name, given) static result (*name)(given);
PYTHON(DECLARE)

/* Whether the process has all of them. */
static int python_is_there(void) {
#define FIND(result, name, given) if (!(name = (result (*)(given))dlsym(RTLD_DEFAULT, #name))) return 0;
    PYTHON(FIND)
    return 1;
}

/* Start Python, and leave the host its signals and its threads. */
static void start_python(void) {
    struct sigaction interrupt;
    sigaction(SIGINT, NULL, &interrupt);
    int *in_utf8 = dlsym(RTLD_DEFAULT, "Py_UTF8Mode"); /* paths are, whatever the locale; 3.15 has no other mode */
    if (in_utf8) *in_utf8 = 1;
    Py_InitializeEx(0);
    PyImport_ImportModule("signal"); /* takes the interrupt when it is first imported, whatever was asked for */
    sigaction(SIGINT, &interrupt, NULL);
    PyEval_SaveThread();
}

/* Whether the Python that runs can import numpy; once it did, the next time costs nothing. */
static int numpy_is_there(void) {
    int held = PyGILState_Ensure();
    int there = PyImport_ImportModule("numpy") != NULL;
    if (!there) PyErr_Clear();
    PyGILState_Release(held);
    return there;
}

/* See to it that a Python with numpy runs in this process. Returns why not, NULL where one does. */
static const char *ensure_python(void) {
    static char home[MOST], modules[MOST];
    if (!dlsym(RTLD_DEFAULT, "Py_IsInitialized")) {
        const char *why = bring_python(home, modules);
        if (why) return why;
    }
    if (!python_is_there()) return "this FMU runs in Python, and the one of this process lacks functions";
    if (!Py_IsInitialized()) {
        /* One that was brought does not know where it is installed. */
        char *home_before = *home ? exchanged("PYTHONHOME", home) : NULL;
        char *path_before = *home ? exchanged("PYTHONPATH", modules) : NULL;
        start_python();
        if (*home) {
            free(exchanged("PYTHONHOME", home_before));
            free(exchanged("PYTHONPATH", path_before));
        }
        free(home_before);
        free(path_before);
    }
    return numpy_is_there() ? NULL : "this FMU needs numpy, and the Python that runs here has none: install it there";
}

/* Load PythonFMU's library, which lies beside this one. Returns why not, NULL where it is there. */
static const char *load(void) {
    static char path[PATH_MAX];
    const char *why = ensure_python();
    if (why) return why;
    Dl_info here;
    if (!dladdr((void *)load, &here)) return "the folder of this library is not known";
    const char *end = strrchr(here.dli_fname, '/');
    snprintf(path, sizeof path, "%.*s%s", end ? (int)(end - here.dli_fname) + 1 : 0, here.dli_fname, BEHIND);
    void *there = dlopen(path, RTLD_LAZY | RTLD_LOCAL);
    if (!there) return dlerror();
#define CONNECT(name) to_##name = dlsym(there, #name);
    FUNCTIONS(CONNECT)
    instantiate = (Instantiate)dlsym(there, "fmi2Instantiate");
    library = there;
    return NULL;
}

/* A URI without its escapes, of which PythonFMU undoes that of the blank alone. */
static void unescape(const char *uri, char *plain, size_t size) {
    size_t length = 0;
    for (unsigned byte; *uri && length + 1 < size; length++) {
        int escaped = uri[0] == '%' && isxdigit((unsigned char)uri[1]) && sscanf(uri, "%%%2x", &byte) == 1;
        plain[length] = escaped ? (char)byte : *uri;
        uri += escaped ? 3 : 1;
    }
    plain[length] = 0;
}

__attribute__((visibility("default"))) void *fmi2Instantiate(
        const char *instance, int kind, const char *guid, const char *resources, const void *functions, int visible,
        int logging) {
    const Callbacks *host = functions;
    const char *why = library ? NULL : load();
    char folder[PATH_MAX];
    unescape(resources ? resources : "", folder, sizeof folder);
    if (!why && strstr(folder, "%20")) why = "this FMU lies in a path with %20 in it, where PythonFMU finds nothing";
    if (!why) return instantiate(instance, kind, guid, folder, functions, visible, logging);
    fprintf(stderr, "%s: %s\n", instance ? instance : "FMU", why);
    if (host && host->log) host->log(host->environment, instance, ERROR, "logStatusError", "%s", why);
    return NULL;
}

__attribute__((destructor)) static void unload(void) {
    if (library) dlclose(library);
}
