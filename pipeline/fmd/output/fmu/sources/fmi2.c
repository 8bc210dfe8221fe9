/* The interface of FMI 2.0 (Functional Mock-up Interface for Model Exchange and Co-Simulation, 2.0.4). */
#include <math.h>
#include <string.h>

#include "instance.h"

typedef int Flag;
typedef int Status; /* OK 0, warning 1, discard 2, error 3, fatal 4, pending 5 */
typedef void (*Logger)(void *environment, const char *name, Status status, const char *category, const char *text, ...);

typedef struct {
    Logger logger;
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*step_finished)(void *, Status);
    void *environment;
} Callbacks;

typedef struct {
    int again, terminate, nominals_changed, states_changed, next_defined;
    double next;
} EventInfo;

static Status fail(Instance *c, const char *text)
{
    if (c->log)
        ((Logger)c->log)(c->environment, c->name, 3, "logStatusError", "%s", text);
    return 3;
}

#define FMI(NAME) fmi2##NAME
#define FMI_STATE(VERB) fmi2##VERB##FMUstate
#include "calls.h"

EXPORT const char *fmi2GetTypesPlatform(void)
{
    return "default";
}

EXPORT const char *fmi2GetVersion(void)
{
    return "2.0";
}

EXPORT void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources,
                             const Callbacks *callbacks, int visible, int logs)
{
    (void)resources, (void)visible;
    if (!guid || strcmp(guid, MODEL_TOKEN) != 0) {
        if (callbacks && callbacks->logger)
            callbacks->logger(callbacks->environment, name, 3, "logStatusError", "%s",
                              "the binary is of another model than its description");
        return NULL;
    }
    Instance *c = instance_create(name, type == 1);
    if (c) {
        c->logs = logs;
        c->environment = callbacks ? callbacks->environment : NULL;
        c->log = callbacks ? (void (*)(void))callbacks->logger : NULL;
    }
    return c;
}

EXPORT void fmi2FreeInstance(void *c)
{
    instance_free(c);
}

EXPORT Status fmi2SetupExperiment(void *instance, int has_tolerance, double tolerance, double start, int has_stop,
                                  double stop)
{
    Instance *c = instance;
    (void)has_stop, (void)stop;
    if (!isfinite(start))
        return fail(c, "the start time isn't finite");
    c->model.time = start;
    if (has_tolerance && c->co_simulation && !model_set(&c->model, FIRST_PARAMETER + TOLERANCE, tolerance))
        return fail(c, "the tolerance isn't above 0");
    instance_changed(c);
    return need(c, c->mode == CREATED);
}

EXPORT Status fmi2EnterInitializationMode(void *instance)
{
    Instance *c = instance;
    const Status status = need(c, c->mode == CREATED);
    c->mode = INITIALIZING;
    model_pass_breakpoints(&c->model);
    instance_changed(c);
    return status;
}

EXPORT Status fmi2GetReal(void *instance, const unsigned refs[], size_t n, double values[])
{
    for (size_t k = 0; k < n; ++k)
        if (!instance_get(instance, refs[k], values + k))
            return fail(instance, "no such value");
    return 0;
}

EXPORT Status fmi2SetReal(void *instance, const unsigned refs[], size_t n, const double values[])
{
    for (size_t k = 0; k < n; ++k) {
        const char *wrong = instance_set(instance, refs[k], values[k]);
        if (wrong)
            return fail(instance, wrong);
    }
    return 0;
}

/* All values are real numbers. */
#define NO_VALUES(NAME, TYPE)                                                            \
    EXPORT Status fmi2Get##NAME(void *c, const unsigned refs[], size_t n, TYPE values[]) \
    {                                                                                    \
        (void)refs, (void)values;                                                        \
        return n ? fail(c, "all values are real numbers") : 0;                           \
    }                                                                                    \
    EXPORT Status fmi2Set##NAME(void *c, const unsigned refs[], size_t n, const TYPE values[]) \
    {                                                                                    \
        (void)refs, (void)values;                                                        \
        return n ? fail(c, "all values are real numbers") : 0;                           \
    }

typedef const char *Text;
NO_VALUES(Integer, int)
NO_VALUES(Boolean, int)
NO_VALUES(String, Text)

EXPORT Status fmi2SerializedFMUstateSize(void *instance, void *state, size_t *size)
{
    (void)instance, (void)state;
    *size = sizeof(Snapshot);
    return 0;
}

EXPORT Status fmi2SerializeFMUstate(void *instance, void *state, char bytes[], size_t size)
{
    if (size < sizeof(Snapshot))
        return fail(instance, "there is no room for the state");
    memcpy(bytes, state, sizeof(Snapshot));
    return 0;
}

EXPORT Status fmi2DeSerializeFMUstate(void *instance, const char bytes[], size_t size, void **state)
{
    *state = snapshot_read(bytes, size);
    return *state ? 0 : fail(instance, "these bytes are no state of this model");
}

EXPORT Status fmi2GetDirectionalDerivative(void *instance, const unsigned unknowns[], size_t n_unknowns,
                                           const unsigned knowns[], size_t n_knowns, const double seed[],
                                           double change[])
{
    const char *wrong = instance_derivative(instance, unknowns, n_unknowns, knowns, n_knowns, seed, change);
    return wrong ? fail(instance, wrong) : 0;
}

/* Model exchange. */

EXPORT Status fmi2NewDiscreteStates(void *instance, EventInfo *info)
{
    Instance *c = instance;
    info->again = info->terminate = info->nominals_changed = info->states_changed = 0;
    info->next = model_pass_breakpoints(&c->model);
    info->next_defined = isfinite(info->next) ? 1 : 0;
    instance_changed(c);
    return need(c, c->mode == EVENT);
}

EXPORT Status fmi2GetDerivatives(void *instance, double dx[], size_t n)
{
    return get_derivatives(instance, dx, n);
}

/* Co-simulation. */

EXPORT Status fmi2SetRealInputDerivatives(void *c, const unsigned refs[], size_t n, const int orders[],
                                          const double values[])
{
    (void)refs, (void)orders, (void)values;
    return n ? fail(c, "inputs are held over a step") : 0;
}

EXPORT Status fmi2GetRealOutputDerivatives(void *c, const unsigned refs[], size_t n, const int orders[],
                                           double values[])
{
    (void)refs, (void)orders, (void)values;
    return n ? fail(c, "there are no derivatives of outputs") : 0;
}

EXPORT Status fmi2DoStep(void *instance, double time, double step, int no_return)
{
    const char *wrong = instance_step(instance, time, step);
    (void)no_return;
    return wrong ? fail(instance, wrong) : 0;
}

EXPORT Status fmi2CancelStep(void *c)
{
    return fail(c, "no step is pending");
}

EXPORT Status fmi2GetStatus(void *c, int kind, Status *value)
{
    (void)kind, (void)value;
    return fail(c, "no step is pending");
}

EXPORT Status fmi2GetRealStatus(void *instance, int kind, double *value)
{
    if (kind != 2)
        return fail(instance, "no step is pending");
    *value = ((Instance *)instance)->model.time;
    return 0;
}

EXPORT Status fmi2GetIntegerStatus(void *c, int kind, int *value)
{
    (void)kind, (void)value;
    return fail(c, "no step is pending");
}

EXPORT Status fmi2GetBooleanStatus(void *instance, int kind, int *value)
{
    if (kind != 3)
        return fail(instance, "no step is pending");
    *value = ((Instance *)instance)->mode == FAILED;
    return 0;
}

EXPORT Status fmi2GetStringStatus(void *c, int kind, const char **value)
{
    (void)kind, (void)value;
    return fail(c, "no step is pending");
}
