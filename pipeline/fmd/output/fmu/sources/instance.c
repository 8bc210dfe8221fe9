#include "instance.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

Instance *instance_create(const char *name, int co_simulation)
{
    Instance *instance = calloc(1, sizeof *instance);
    if (!instance)
        return NULL;
    const size_t size = strlen(name ? name : "") + 1;
    char *copy = malloc(size);
    if (!copy) {
        free(instance);
        return NULL;
    }
    memcpy(copy, name ? name : "", size);
    instance->name = copy;
    instance->co_simulation = co_simulation;
    instance_reset(instance);
    return instance;
}

void instance_free(Instance *instance)
{
    if (!instance)
        return;
    free((char *)instance->name);
    free(instance);
}

void instance_reset(Instance *instance)
{
    model_reset(&instance->model);
    instance->mode = CREATED;
    instance_changed(instance);
}

void instance_changed(Instance *instance)
{
    instance->has_derivatives = instance->has_outputs = 0;
}

static void compute_derivatives(Instance *instance)
{
    if (!instance->has_derivatives)
        model_present_derivatives(&instance->model, instance->derivatives);
    instance->has_derivatives = 1;
}

int instance_get(Instance *instance, unsigned reference, double *value)
{
    const Model *m = &instance->model;
    if (reference == 0)
        *value = m->time;
    else if (reference < FIRST_DERIVATIVE)
        *value = m->x[reference - FIRST_STATE];
    else if (reference < FIRST_INPUT) {
        compute_derivatives(instance);
        *value = instance->derivatives[reference - FIRST_DERIVATIVE];
    } else if (reference < FIRST_PARAMETER)
        *value = m->u[reference - FIRST_INPUT];
    else if (reference < FIRST_OUTPUT)
        *value = m->p[reference - FIRST_PARAMETER];
    else if (reference < END_OF_VALUES) {
        compute_derivatives(instance);
        if (!instance->has_outputs)
            model_outputs(m, instance->derivatives, instance->outputs);
        instance->has_outputs = 1;
        *value = instance->outputs[reference - FIRST_OUTPUT];
    } else
        return 0;
    return 1;
}

const char *instance_set(Instance *instance, unsigned reference, double value)
{
    const int starting = instance->mode == CREATED || instance->mode == INITIALIZING;
    if (reference < FIRST_INPUT && !(starting && reference >= FIRST_STATE && reference < FIRST_DERIVATIVE))
        return "a state can be set before the simulation begins only; the time and derivatives can't be set";
    if (reference == FIRST_PARAMETER + TOLERANCE && !starting)
        return "the tolerance can be set before the simulation begins only";
    if (!model_set(&instance->model, reference, value))
        return "no such input, parameter or state, or its value isn't finite, or the tolerance isn't above 0";
    instance_changed(instance);
    return NULL;
}

const char *instance_step(Instance *instance, double time, double step)
{
    Model *m = &instance->model;
    const double target = time + step;
    if (instance->mode != STEPPING)
        return "a step can be taken by a co-simulation after its initialization only";
    if (!(step >= 0.0) || !isfinite(target) || fabs(time - m->time) > 1e-9 * (1.0 + fabs(time)))
        return "the communication point isn't where the last step ended, or the step isn't a finite length above 0";
    instance_changed(instance);
    const Advance advance = target > m->time ? model_advance(m, target) : ADVANCED;
    if (advance == ADVANCED)
        return NULL;
    instance->mode = FAILED;
    return advance == STEP_TOO_SMALL
               ? "the integrator's step became too small: the motion or a load isn't finite, or diverges"
               : "the next communication point takes more than ten million steps: a spring or a load is far too fast";
}

const char *instance_derivative(Instance *instance, const unsigned *unknowns, size_t n_unknowns,
                                const unsigned *knowns, size_t n_knowns, const double *seed, double *change)
{
    double x[N_STATES] = {0.0}, u[N_INPUTS + 1] = {0.0}, p[N_PARAMETERS] = {0.0};
    double dx[N_STATES] = {0.0}, dy[N_OUTPUTS + 1] = {0.0};
    for (size_t k = 0; k < n_knowns; ++k) {
        const unsigned known = knowns[k];
        if (known >= FIRST_STATE && known < FIRST_DERIVATIVE)
            x[known - FIRST_STATE] += seed[k];
        else if (known >= FIRST_INPUT && known < FIRST_PARAMETER)
            u[known - FIRST_INPUT] += seed[k];
        else if (known >= FIRST_PARAMETER && known < FIRST_OUTPUT)
            p[known - FIRST_PARAMETER] += seed[k];
        else
            return "a known value must be a state, an input or a parameter";
    }
    model_slopes(&instance->model, x, u, p, dx, dy);
    for (size_t k = 0; k < n_unknowns; ++k) {
        const unsigned unknown = unknowns[k];
        if (unknown >= FIRST_DERIVATIVE && unknown < FIRST_INPUT)
            change[k] = dx[unknown - FIRST_DERIVATIVE];
        else if (unknown >= FIRST_OUTPUT && unknown < END_OF_VALUES)
            change[k] = dy[unknown - FIRST_OUTPUT];
        else
            return "an unknown value must be a derivative of a state or an output";
    }
    return NULL;
}

Snapshot *snapshot_take(const Instance *instance, Snapshot *old)
{
    Snapshot *snapshot = old ? old : calloc(1, sizeof *snapshot);
    if (!snapshot)
        return NULL;
    memcpy(snapshot->token, MODEL_TOKEN, sizeof snapshot->token);
    snapshot->mode = instance->mode;
    snapshot->model = instance->model;
    return snapshot;
}

void snapshot_free(Snapshot *snapshot)
{
    free(snapshot);
}

void snapshot_restore(Instance *instance, const Snapshot *snapshot)
{
    instance->mode = (Mode)snapshot->mode;
    const int wide = instance->model.wide;
    instance->model = snapshot->model; /* it may come from another machine */
    instance->model.wide = wide;
    instance_changed(instance);
}

Snapshot *snapshot_read(const void *bytes, size_t size)
{
    Snapshot *snapshot;
    if (size != sizeof *snapshot || memcmp(bytes, MODEL_TOKEN, sizeof MODEL_TOKEN) != 0)
        return NULL;
    snapshot = malloc(sizeof *snapshot);
    if (snapshot)
        memcpy(snapshot, bytes, size);
    return snapshot;
}
