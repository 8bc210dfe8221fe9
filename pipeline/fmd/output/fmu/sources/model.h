/* A mechanism: its state, what drives it and what comes out. The files equations.h and equations.c are generated.

   A value is named by a reference: 0 is the time; then come the states (positions, then rates), their derivatives,
   inputs, parameters and outputs. */
#ifndef MODEL_H
#define MODEL_H

#include <stddef.h>

#include "equations.h"

#define FIRST_STATE 1
#define FIRST_DERIVATIVE (FIRST_STATE + N_STATES)
#define FIRST_INPUT (FIRST_DERIVATIVE + N_STATES)
#define FIRST_PARAMETER (FIRST_INPUT + N_INPUTS)
#define FIRST_OUTPUT (FIRST_PARAMETER + N_PARAMETERS)
#define END_OF_VALUES (FIRST_OUTPUT + N_OUTPUTS)

/* Of the parameters: constants of the mechanism, factors of its own loads and motions, the tolerance of a step. */
#define FIRST_FACTOR N_CONSTANTS
#define TOLERANCE (N_CONSTANTS + N_OWN)

/* All of a simulation's state, without pointers, so that a copy of its bytes is a copy of it. */
typedef struct {
    double time;
    double x[N_STATES];
    double u[N_INPUTS + 1];
    double p[N_PARAMETERS];
    unsigned passed; /* breakpoints of the loads that lie behind */
    int loaded;   /* forces act on markers */
    int wide;     /* this processor has wide vectors */

    /* The integrator, which may be ahead of the time: it stands at `reached`, and its last step began at `begun`. */
    int restart;  /* something was set since: go on from time and x */
    int steady;   /* nothing was set between the last two calls: the last step may lead beyond their end */
    int fresh;    /* the first slope of the next step has to be evaluated */
    int prepared; /* coefficients of the last step's interpolation are there */
    unsigned done; /* breakpoints behind `reached` */
    double reached, begun, next_step;
    double n_steps, n_evaluations;
    double largest[N_GROUPS];
    double begin[N_STATES], end[N_STATES];
    double slopes[16][N_STATES];
    double dense[7][N_STATES];
} Model;

/* Set all to the start. */
void model_reset(Model *m);

/* Derivatives of the states x at a time, loads evaluated just there. */
void model_derivatives(const Model *m, double time, const double *x, double *dx);

/* Derivatives at the present time, on the side of a jump of the loads that the simulation is on. */
void model_present_derivatives(const Model *m, double *dx);

/* Outputs at the present time, where the derivatives are dx. */
void model_outputs(const Model *m, const double *dx, double *y);

/* Change of derivatives and outputs with states, inputs and parameters. */
void model_slopes(const Model *m, const double *x_change, const double *u_change, const double *p_change, double *dx,
                  double *dy);

/* Set an input, parameter or state; returns 0 if the reference is of none or the value isn't finite. */
int model_set(Model *m, unsigned reference, double value);

/* Count the breakpoints up to the present time; returns the next one, infinity if there is none. */
double model_pass_breakpoints(Model *m);

typedef enum { ADVANCED, STEP_TOO_SMALL, TOO_MANY_STEPS } Advance;

/* Advance to a time; where that fails, the state is that at `reached`. */
Advance model_advance(Model *m, double target);

double just_after(double t);
double just_before(double t);

#endif
