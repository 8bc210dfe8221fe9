#include "model.h"
#include "wide.h"

#include <math.h>
#include <string.h>

/* A time this close to a breakpoint is meant to be on it. */
#define CLOSE(t) (1e-12 * (1.0 + fabs(t)))

double just_after(double t)
{
    return nextafter(t, INFINITY);
}

double just_before(double t)
{
    return nextafter(t, -INFINITY);
}

void model_reset(Model *m)
{
    memset(m, 0, sizeof *m);
    memcpy(m->x, start_states, sizeof m->x);
    memcpy(m->p, start_parameters, sizeof m->p);
    m->restart = 1;
    m->steady = 1;
    m->wide = has_wide_vectors();
    m->next_step = FIRST_STEP;
}

static void set_marker_inputs(const Model *m, double *inputs)
{
    for (int k = N_FIRST_MARKER_INPUT; k < N_INPUTS; ++k)
        inputs[input_places[k]] = m->u[k];
}

static void set_own_signals(double time, double *inputs)
{
    own_signals((const double *const[]){&time}, (double *const[]){inputs});
}

/* Value, rate and acceleration of every load and motion; those on markers only where one acts. */
static void set_inputs(const Model *m, double time, double *inputs)
{
    set_own_signals(time, inputs);
    for (int k = 0; k < N_OWN; ++k)
        for (int j = 0; j < 3; ++j)
            inputs[3 * k + j] *= m->p[FIRST_FACTOR + k];
    for (int k = 0; k < N_FIRST_MARKER_INPUT; ++k)
        inputs[input_places[k]] += m->u[k];
    if (m->loaded)
        set_marker_inputs(m, inputs);
}

/* Positions with unit quaternions; they are the given ones where there are none. */
static const double *unit_positions(const double *x, double *room)
{
#if N_QUATERNIONS
    memcpy(room, x, N_POSITIONS * sizeof *x);
    for (int k = 0; k < N_QUATERNIONS; ++k) {
        double *e = room + quaternions[k][1];
        const double size = sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2] + e[3] * e[3]);
        for (int j = 0; j < 4; ++j)
            e[j] /= size;
    }
    return room;
#else
    (void)room;
    return x;
#endif
}

/* How positions change: as the rates, quaternions by half the product with the body's own rates of rotation. */
static void position_rates(const double *x, const double *v, double *dq)
{
#if N_QUATERNIONS
    for (int k = 0; k < N_RATES; ++k)
        if (rate_positions[k] >= 0)
            dq[rate_positions[k]] = v[k];
    for (int k = 0; k < N_QUATERNIONS; ++k) {
        const double *w = v + quaternions[k][0], *e = x + quaternions[k][1];
        double *de = dq + quaternions[k][1];
        de[0] = 0.5 * (e[3] * w[0] + e[1] * w[2] - e[2] * w[1]);
        de[1] = 0.5 * (e[3] * w[1] - e[0] * w[2] + e[2] * w[0]);
        de[2] = 0.5 * (e[3] * w[2] + e[0] * w[1] - e[1] * w[0]);
        de[3] = -0.5 * (e[0] * w[0] + e[1] * w[1] + e[2] * w[2]);
    }
#else
    (void)x;
    memcpy(dq, v, N_POSITIONS * sizeof *dq);
#endif
}

void model_derivatives(const Model *m, double time, const double *x, double *dx)
{
    double inputs[3 * N_SIGNALS + 1], room[N_POSITIONS];
    set_inputs(m, time, inputs);
    const double *q = unit_positions(x, room), *v = x + N_POSITIONS;
    const double *const in[] = {m->p, inputs, q, v};
    double *const out[] = {dx + N_POSITIONS};
    position_rates(x, v, dx);
    if (m->loaded)
        loaded_accelerations(in, out);
#if HAS_WIDE
    else if (m->wide)
        accelerations_wide(in, out);
#endif
    else
        accelerations(in, out);
}

static double present_side(const Model *m)
{
    const double t = m->time;
    if (m->passed > 0 && t <= breakpoints[m->passed - 1] + CLOSE(t))
        return just_after(fmax(t, breakpoints[m->passed - 1]));
    if (fabs(t - breakpoints[m->passed]) <= CLOSE(t))
        return just_before(fmin(t, breakpoints[m->passed]));
    return t;
}

void model_present_derivatives(const Model *m, double *dx)
{
    model_derivatives(m, present_side(m), m->x, dx);
}

void model_outputs(const Model *m, const double *dx, double *y)
{
    double inputs[3 * N_SIGNALS + 1], room[N_POSITIONS];
    set_inputs(m, present_side(m), inputs);
    set_marker_inputs(m, inputs);
    const double *const in[] = {m->p, inputs, unit_positions(m->x, room), m->x + N_POSITIONS, dx + N_POSITIONS};
    double *const out[] = {y};
    outputs(in, out);
}

void model_slopes(const Model *m, const double *x_change, const double *u_change, const double *p_change, double *dx,
                  double *dy)
{
    double inputs[3 * N_SIGNALS + 1], changes[3 * N_SIGNALS + 1], room[N_POSITIONS], moved[N_POSITIONS], now[N_STATES];
    const double *q = unit_positions(m->x, room), *v = m->x + N_POSITIONS, *dv = x_change + N_POSITIONS;
    set_inputs(m, present_side(m), inputs);
    set_marker_inputs(m, inputs);
    memset(changes, 0, sizeof changes);
    set_own_signals(present_side(m), changes);
    for (int k = 0; k < N_OWN; ++k)
        for (int j = 0; j < 3; ++j)
            changes[3 * k + j] *= p_change[FIRST_FACTOR + k];
    for (int k = 0; k < N_INPUTS; ++k)
        changes[input_places[k]] += u_change[k];
    memcpy(moved, x_change, sizeof moved);
    position_rates(m->x, dv, dx); /* bilinear in quaternion and rates */
#if N_QUATERNIONS
    double more[N_POSITIONS];
    position_rates(x_change, v, more);
    for (int k = 0; k < N_QUATERNIONS; ++k) {
        const int at = quaternions[k][1];
        const double *e = m->x + at;
        const double size = sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2] + e[3] * e[3]);
        double along = 0.0;
        for (int j = 0; j < 4; ++j) {
            dx[at + j] += more[at + j];
            along += q[at + j] * x_change[at + j];
        }
        for (int j = 0; j < 4; ++j)
            moved[at + j] = (x_change[at + j] - q[at + j] * along) / size;
    }
#endif
    const double *const in[] = {m->p, inputs, q, v, p_change, changes, moved, dv};
    double *const out[] = {dx + N_POSITIONS};
    slopes(in, out);
    model_present_derivatives(m, now);
    const double *const given[] = {m->p, inputs, q, v, now + N_POSITIONS, p_change, changes, moved, dv, dx + N_POSITIONS};
    double *const changed[] = {dy};
    output_slopes(given, changed);
}

int model_set(Model *m, unsigned reference, double value)
{
    double *place;
    if (!isfinite(value))
        return 0;
    if (reference >= FIRST_STATE && reference < FIRST_DERIVATIVE)
        place = m->x + (reference - FIRST_STATE);
    else if (reference >= FIRST_INPUT && reference < FIRST_PARAMETER)
        place = m->u + (reference - FIRST_INPUT);
    else if (reference >= FIRST_PARAMETER && reference < FIRST_OUTPUT)
        place = m->p + (reference - FIRST_PARAMETER);
    else
        return 0;
    if (*place == value)
        return 1;
    if (reference == FIRST_PARAMETER + TOLERANCE && !(value > 0.0))
        return 0;
    *place = value;
    m->restart = 1;
    if (reference >= FIRST_INPUT && reference < FIRST_PARAMETER) {
        m->loaded = 0;
        for (int k = N_FIRST_MARKER_INPUT; k < N_INPUTS; ++k)
            m->loaded |= m->u[k] != 0.0;
    }
    return 1;
}

double model_pass_breakpoints(Model *m)
{
    m->passed = 0;
    while (breakpoints[m->passed] <= m->time + CLOSE(m->time)) /* the last one is infinity */
        ++m->passed;
    return breakpoints[m->passed];
}
