/* Functions that both versions of the interface have alike.

   Before it is included, FMI(NAME) is the exported name, FMI_STATE(VERB) that of a function of whole states, Flag and
   Status are the version's types, and fail() reports. */
#ifndef CALLS_H
#define CALLS_H

#include <math.h>
#include <string.h>

#include "instance.h"

static Status need(Instance *c, int right)
{
    return right ? 0 : fail(c, "this function can't be called now");
}

EXPORT Status FMI(SetDebugLogging)(void *c, Flag on, size_t n, const char *const categories[])
{
    (void)n, (void)categories;
    ((Instance *)c)->logs = on;
    return 0;
}

EXPORT Status FMI(ExitInitializationMode)(void *instance)
{
    Instance *c = instance;
    const Status status = need(c, c->mode == INITIALIZING);
    c->mode = c->co_simulation ? STEPPING : EVENT;
    return status;
}

EXPORT Status FMI(Terminate)(void *instance)
{
    ((Instance *)instance)->mode = ENDED;
    return 0;
}

EXPORT Status FMI(Reset)(void *instance)
{
    instance_reset(instance);
    return 0;
}

EXPORT Status FMI(EnterEventMode)(void *instance)
{
    Instance *c = instance;
    const Status status = need(c, c->mode == CONTINUOUS || c->mode == EVENT);
    c->mode = EVENT;
    return status;
}

EXPORT Status FMI(EnterContinuousTimeMode)(void *instance)
{
    Instance *c = instance;
    const Status status = need(c, c->mode == EVENT);
    c->mode = CONTINUOUS;
    return status;
}

EXPORT Status FMI(CompletedIntegratorStep)(void *instance, Flag no_return, Flag *enter_event, Flag *terminate)
{
    (void)no_return;
    *enter_event = *terminate = 0;
    return need(instance, ((Instance *)instance)->mode == CONTINUOUS);
}

EXPORT Status FMI(SetTime)(void *instance, double time)
{
    Instance *c = instance;
    if (!isfinite(time))
        return fail(c, "the time isn't finite");
    c->model.time = time;
    instance_changed(c);
    return 0;
}

EXPORT Status FMI(SetContinuousStates)(void *instance, const double x[], size_t n)
{
    Instance *c = instance;
    if (n != N_STATES)
        return fail(c, "this isn't the number of states");
    memcpy(c->model.x, x, sizeof c->model.x);
    instance_changed(c);
    return 0;
}

EXPORT Status FMI(GetContinuousStates)(void *instance, double x[], size_t n)
{
    Instance *c = instance;
    if (n != N_STATES)
        return fail(c, "this isn't the number of states");
    memcpy(x, c->model.x, sizeof c->model.x);
    return 0;
}

EXPORT Status FMI(GetEventIndicators)(void *instance, double z[], size_t n)
{
    (void)z;
    return n ? fail(instance, "there are no event indicators") : 0;
}

EXPORT Status FMI(GetNominalsOfContinuousStates)(void *instance, double x[], size_t n)
{
    if (n != N_STATES)
        return fail(instance, "this isn't the number of states");
    memcpy(x, nominal_states, sizeof nominal_states);
    return 0;
}

static Status get_derivatives(void *instance, double dx[], size_t n)
{
    Instance *c = instance;
    if (n != N_STATES)
        return fail(c, "this isn't the number of states");
    model_present_derivatives(&c->model, dx);
    for (size_t k = 0; k < n; ++k)
        if (!isfinite(dx[k]))
            return 2; /* a step that the importer may take again, shorter */
    return 0;
}

EXPORT Status FMI_STATE(Get)(void *instance, void **state)
{
    *state = snapshot_take(instance, *state);
    return *state ? 0 : fail(instance, "no memory is left");
}

EXPORT Status FMI_STATE(Set)(void *instance, void *state)
{
    if (!state)
        return fail(instance, "no state is given");
    snapshot_restore(instance, state);
    return 0;
}

EXPORT Status FMI_STATE(Free)(void *instance, void **state)
{
    (void)instance;
    snapshot_free(*state);
    *state = NULL;
    return 0;
}

#endif
