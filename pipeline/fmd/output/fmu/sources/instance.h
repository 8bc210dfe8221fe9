/* What both versions of the interface share: an instance of the model with its mode, and access to its values. */
#ifndef INSTANCE_H
#define INSTANCE_H

#include "model.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef enum { CREATED, INITIALIZING, EVENT, CONTINUOUS, STEPPING, ENDED, FAILED } Mode;

typedef struct {
    Model model;
    Mode mode;
    int co_simulation;
    int logs;
    int has_derivatives, has_outputs; /* the two below are those of the present state */
    double derivatives[N_STATES];
    double outputs[N_OUTPUTS + 1];
    void *environment;
    void (*log)(void);
    const char *name;
} Instance;

/* A copy of the simulation's state: the same bytes in memory and in a file. */
typedef struct {
    char token[sizeof MODEL_TOKEN];
    int mode;
    Model model;
} Snapshot;

Instance *instance_create(const char *name, int co_simulation);
void instance_free(Instance *instance);
void instance_reset(Instance *instance);

/* Forget what was computed for the state before. */
void instance_changed(Instance *instance);

/* Value of a reference; returns 0 if there is none. */
int instance_get(Instance *instance, unsigned reference, double *value);

/* Set a value; returns NULL, or why it can't be set now. */
const char *instance_set(Instance *instance, unsigned reference, double value);

/* Advance a co-simulation; returns NULL, or what went wrong. */
const char *instance_step(Instance *instance, double time, double step);

/* Sum over known values k of d unknown / d known k times seed k; returns NULL, or what went wrong. */
const char *instance_derivative(Instance *instance, const unsigned *unknowns, size_t n_unknowns,
                                const unsigned *knowns, size_t n_knowns, const double *seed, double *change);

Snapshot *snapshot_take(const Instance *instance, Snapshot *old);
void snapshot_free(Snapshot *snapshot);
void snapshot_restore(Instance *instance, const Snapshot *snapshot);

/* A snapshot of bytes; NULL if they are of another model. */
Snapshot *snapshot_read(const void *bytes, size_t size);

#endif
