/* The interface of FMI 3.0 (Functional Mock-up Interface 3.0.2). */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include "instance.h"

typedef bool Flag;
typedef int Status; /* OK 0, warning 1, discard 2, error 3, fatal 4 */
typedef uint32_t Ref;
typedef void (*Logger)(void *environment, Status status, const char *category, const char *text);

static Status fail(Instance *c, const char *text)
{
    if (c->log)
        ((Logger)c->log)(c->environment, 3, "logStatusError", text);
    return 3;
}

#define FMI(NAME) fmi3##NAME
#define FMI_STATE(VERB) fmi3##VERB##FMUState
#include "calls.h"

static void *create(const char *name, const char *token, bool logs, void *environment, Logger log, int co_simulation)
{
    if (!token || strcmp(token, MODEL_TOKEN) != 0) {
        if (log)
            log(environment, 3, "logStatusError", "the binary is of another model than its description");
        return NULL;
    }
    Instance *c = instance_create(name, co_simulation);
    if (c) {
        c->logs = logs;
        c->environment = environment;
        c->log = (void (*)(void))log;
    }
    return c;
}

EXPORT const char *fmi3GetVersion(void)
{
    return "3.0";
}

EXPORT void *fmi3InstantiateModelExchange(const char *name, const char *token, const char *resources, bool visible,
                                          bool logs, void *environment, Logger log)
{
    (void)resources, (void)visible;
    return create(name, token, logs, environment, log, 0);
}

EXPORT void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible,
                                         bool logs, bool events, bool early, const Ref needed[], size_t n_needed,
                                         void *environment, Logger log, void (*update)(void))
{
    (void)resources, (void)visible, (void)early, (void)needed, (void)n_needed, (void)update;
    if (events) {
        if (log)
            log(environment, 3, "logStatusError", "a co-simulation has no event mode");
        return NULL;
    }
    return create(name, token, logs, environment, log, 1);
}

EXPORT void *fmi3InstantiateScheduledExecution(const char *name, const char *token, const char *resources,
                                               bool visible, bool logs, void *environment, Logger log,
                                               void (*update)(void), void (*lock)(void), void (*unlock)(void))
{
    (void)name, (void)token, (void)resources, (void)visible, (void)logs, (void)update, (void)lock, (void)unlock;
    if (log)
        log(environment, 3, "logStatusError", "there is no scheduled execution");
    return NULL;
}

EXPORT void fmi3FreeInstance(void *c)
{
    instance_free(c);
}

EXPORT Status fmi3EnterInitializationMode(void *instance, bool has_tolerance, double tolerance, double start,
                                          bool has_stop, double stop)
{
    Instance *c = instance;
    (void)has_stop, (void)stop;
    const Status status = need(c, c->mode == CREATED);
    if (!isfinite(start))
        return fail(c, "the start time isn't finite");
    if (has_tolerance && c->co_simulation && !model_set(&c->model, FIRST_PARAMETER + TOLERANCE, tolerance))
        return fail(c, "the tolerance isn't above 0");
    c->model.time = start;
    c->mode = INITIALIZING;
    model_pass_breakpoints(&c->model);
    instance_changed(c);
    return status;
}

EXPORT Status fmi3GetFloat64(void *instance, const Ref refs[], size_t n, double values[], size_t n_values)
{
    if (n != n_values)
        return fail(instance, "each value is one number");
    for (size_t k = 0; k < n; ++k)
        if (!instance_get(instance, refs[k], values + k))
            return fail(instance, "no such value");
    return 0;
}

EXPORT Status fmi3SetFloat64(void *instance, const Ref refs[], size_t n, const double values[], size_t n_values)
{
    if (n != n_values)
        return fail(instance, "each value is one number");
    for (size_t k = 0; k < n; ++k) {
        const char *wrong = instance_set(instance, refs[k], values[k]);
        if (wrong)
            return fail(instance, wrong);
    }
    return 0;
}

/* All values are numbers of 64 bits. */
#define NO_VALUES(NAME, TYPE)                                                                               \
    EXPORT Status fmi3Get##NAME(void *c, const Ref refs[], size_t n, TYPE values[], size_t n_values)        \
    {                                                                                                       \
        (void)refs, (void)values, (void)n_values;                                                           \
        return n ? fail(c, "all values are of type Float64") : 0;                                           \
    }                                                                                                       \
    EXPORT Status fmi3Set##NAME(void *c, const Ref refs[], size_t n, const TYPE values[], size_t n_values)  \
    {                                                                                                       \
        (void)refs, (void)values, (void)n_values;                                                           \
        return n ? fail(c, "all values are of type Float64") : 0;                                           \
    }

typedef const char *Text;
NO_VALUES(Float32, float)
NO_VALUES(Int8, int8_t)
NO_VALUES(UInt8, uint8_t)
NO_VALUES(Int16, int16_t)
NO_VALUES(UInt16, uint16_t)
NO_VALUES(Int32, int32_t)
NO_VALUES(UInt32, uint32_t)
NO_VALUES(Int64, int64_t)
NO_VALUES(UInt64, uint64_t)
NO_VALUES(Boolean, bool)
NO_VALUES(String, Text)

EXPORT Status fmi3GetBinary(void *c, const Ref refs[], size_t n, size_t sizes[], const uint8_t *values[],
                            size_t n_values)
{
    (void)refs, (void)sizes, (void)values, (void)n_values;
    return n ? fail(c, "all values are of type Float64") : 0;
}

EXPORT Status fmi3SetBinary(void *c, const Ref refs[], size_t n, const size_t sizes[], const uint8_t *const values[],
                            size_t n_values)
{
    (void)refs, (void)sizes, (void)values, (void)n_values;
    return n ? fail(c, "all values are of type Float64") : 0;
}

/* There are no clocks. */
#define NO_CLOCKS(NAME, ...)                                               \
    EXPORT Status fmi3##NAME(void *c, const Ref refs[], size_t n, __VA_ARGS__) \
    {                                                                      \
        (void)refs;                                                        \
        return n ? fail(c, "there are no clocks") : 0;                     \
    }

NO_CLOCKS(GetClock, bool *a)
NO_CLOCKS(SetClock, const bool *a)
NO_CLOCKS(GetIntervalDecimal, double *a, int *b)
NO_CLOCKS(GetIntervalFraction, uint64_t *a, uint64_t *b, int *d)
NO_CLOCKS(GetShiftDecimal, double *a)
NO_CLOCKS(GetShiftFraction, uint64_t *a, uint64_t *b)
NO_CLOCKS(SetIntervalDecimal, const double *a)
NO_CLOCKS(SetIntervalFraction, const uint64_t *a, const uint64_t *b)
NO_CLOCKS(SetShiftDecimal, const double *a)
NO_CLOCKS(SetShiftFraction, const uint64_t *a, const uint64_t *b)

EXPORT Status fmi3ActivateModelPartition(void *c, Ref clock, double time)
{
    (void)clock, (void)time;
    return fail(c, "there are no clocks");
}

EXPORT Status fmi3GetNumberOfVariableDependencies(void *c, Ref ref, size_t *n)
{
    (void)ref, (void)n;
    return fail(c, "dependencies are those of the model description");
}

EXPORT Status fmi3GetVariableDependencies(void *c, Ref ref, size_t of[], Ref on[], size_t at[], int kinds[], size_t n)
{
    (void)ref, (void)of, (void)on, (void)at, (void)kinds, (void)n;
    return fail(c, "dependencies are those of the model description");
}

EXPORT Status fmi3SerializedFMUStateSize(void *instance, void *state, size_t *size)
{
    (void)instance, (void)state;
    *size = sizeof(Snapshot);
    return 0;
}

EXPORT Status fmi3SerializeFMUState(void *instance, void *state, uint8_t bytes[], size_t size)
{
    if (size < sizeof(Snapshot))
        return fail(instance, "there is no room for the state");
    memcpy(bytes, state, sizeof(Snapshot));
    return 0;
}

EXPORT Status fmi3DeserializeFMUState(void *instance, const uint8_t bytes[], size_t size, void **state)
{
    *state = snapshot_read(bytes, size);
    return *state ? 0 : fail(instance, "these bytes are no state of this model");
}

EXPORT Status fmi3GetDirectionalDerivative(void *instance, const Ref unknowns[], size_t n_unknowns,
                                           const Ref knowns[], size_t n_knowns, const double seed[], size_t n_seed,
                                           double change[], size_t n_change)
{
    if (n_seed != n_knowns || n_change != n_unknowns)
        return fail(instance, "each value is one number");
    const char *wrong = instance_derivative(instance, unknowns, n_unknowns, knowns, n_knowns, seed, change);
    return wrong ? fail(instance, wrong) : 0;
}

EXPORT Status fmi3GetAdjointDerivative(void *c, const Ref unknowns[], size_t n_unknowns, const Ref knowns[],
                                       size_t n_knowns, const double seed[], size_t n_seed, double change[],
                                       size_t n_change)
{
    (void)unknowns, (void)n_unknowns, (void)knowns, (void)n_knowns, (void)seed, (void)n_seed, (void)change;
    (void)n_change;
    return fail(c, "there are no adjoint derivatives");
}

EXPORT Status fmi3EnterConfigurationMode(void *c)
{
    return fail(c, "there are no structural parameters");
}

EXPORT Status fmi3ExitConfigurationMode(void *c)
{
    return fail(c, "there are no structural parameters");
}

/* Model exchange. */

EXPORT Status fmi3EvaluateDiscreteStates(void *instance)
{
    return need(instance, ((Instance *)instance)->mode == EVENT || ((Instance *)instance)->mode == INITIALIZING);
}

EXPORT Status fmi3UpdateDiscreteStates(void *instance, bool *again, bool *terminate, bool *nominals_changed,
                                       bool *states_changed, bool *next_defined, double *next)
{
    Instance *c = instance;
    *again = *terminate = *nominals_changed = *states_changed = false;
    *next = model_pass_breakpoints(&c->model);
    *next_defined = isfinite(*next);
    instance_changed(c);
    return need(c, c->mode == EVENT);
}

EXPORT Status fmi3GetNumberOfEventIndicators(void *instance, size_t *n)
{
    (void)instance;
    *n = 0;
    return 0;
}

EXPORT Status fmi3GetNumberOfContinuousStates(void *instance, size_t *n)
{
    (void)instance;
    *n = N_STATES;
    return 0;
}

EXPORT Status fmi3GetContinuousStateDerivatives(void *instance, double dx[], size_t n)
{
    return get_derivatives(instance, dx, n);
}

/* Co-simulation. */

EXPORT Status fmi3EnterStepMode(void *c)
{
    return fail(c, "a co-simulation has no event mode");
}

EXPORT Status fmi3GetOutputDerivatives(void *c, const Ref refs[], size_t n, const int32_t orders[], double values[],
                                       size_t n_values)
{
    (void)refs, (void)orders, (void)values, (void)n_values;
    return n ? fail(c, "there are no derivatives of outputs") : 0;
}

EXPORT Status fmi3DoStep(void *instance, double time, double step, bool no_return, bool *event_needed,
                         bool *terminate, bool *early, double *last_time)
{
    const char *wrong = instance_step(instance, time, step);
    (void)no_return;
    *event_needed = *early = false;
    *terminate = false;
    *last_time = ((Instance *)instance)->model.time;
    return wrong ? fail(instance, wrong) : 0;
}
