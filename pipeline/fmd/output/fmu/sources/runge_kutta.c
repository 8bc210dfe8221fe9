/* The explicit Runge-Kutta method of order 8 of Dormand and Prince with errors of order 3 and 5 and dense output of
   order 7 (Hairer, Norsett & Wanner, Solving Ordinary Differential Equations I, 2nd ed., section II.10).

   A coordinate's error counts relative to the largest value that its group, coordinates of like kind, has had so far.
   While nothing is set from outside, steps don't depend on the times at which the state is asked for: the last one may
   lead beyond, and is interpolated. */
#include <math.h>
#include <string.h>

#include "coefficients.h"
#include "model.h"

#define FLOOR 1e-12 /* a group that has not moved yet */
#define SEEN_STEPS 1000.0 /* from which on their mean length tells how many more it takes */
#define MOST_STEPS 1e7 /* between two communication points */
#define LEAST 1e-6  /* of the largest value of its kind: a group that hardly moves */

#if HAS_WIDE
#define SUM(row) (m->wide ? add_slopes_wide : add_slopes)[row]
#else
#define SUM(row) add_slopes[row]
#endif

static void keep_largest(double *largest, const double *x)
{
    for (int i = 0; i < N_STATES; ++i) {
        const double size = fabs(x[i]);
        if (!(size <= largest[groups[i]]))
            largest[groups[i]] = size;
    }
}

/* Largest values with the end of a trial step; a group that hardly moves counts beside the largest of its kind. */
static void set_trial(const Model *m, double *trial)
{
    memcpy(trial, m->largest, sizeof m->largest);
    keep_largest(trial, m->end);
#if N_KINDS
    double most[N_KINDS] = {0.0};
    for (int k = 0; k < N_GROUPS; ++k)
        most[kinds[k]] = fmax(most[kinds[k]], trial[k]);
    for (int k = 0; k < N_GROUPS; ++k)
        trial[k] = fmax(trial[k], LEAST * most[kinds[k]]);
#endif
}

static double scaled_error(const double *trial, const double *error)
{
    double worst = 0.0;
    for (int i = 0; i < N_STATES; ++i) {
        if (!(isfinite(error[i]) && isfinite(trial[groups[i]])))
            return NAN;
        worst = fmax(worst, fabs(error[i]) / fmax(trial[groups[i]], FLOOR));
    }
    return worst;
}

static double step_factor(double error, double tolerance)
{
    if (error == 0.0)
        return 4.0;
    if (!isfinite(error))
        return 0.2;
    return fmin(4.0, fmax(0.2, 0.9 * pow(tolerance / error, 0.125)));
}

/* Errors of orders 5 and 3 together; NaN if a value isn't finite. */
static double try_step(Model *m, double h)
{
    double error[N_STATES], trial[N_GROUPS];
    for (int k = 1; k < 13; ++k) {
        const double t = m->begun + h;
        SUM(k)(h, m->slopes, m->begin, m->end);
        model_derivatives(m, stage_times[k] == 1.0 ? just_before(t) : m->begun + stage_times[k] * h, m->end,
                          m->slopes[k]);
    }
    m->n_evaluations += 12.0;
    set_trial(m, trial);
    SUM(THIRD)(h, m->slopes, zeros, error);
    const double third = scaled_error(trial, error);
    SUM(FIFTH)(h, m->slopes, zeros, error);
    const double fifth = scaled_error(trial, error);
    const double size = sqrt(fifth * fifth + 0.01 * third * third);
    return size > 0.0 ? fifth * fifth / size : size;
}

static void settle(double *x)
{
#if N_QUATERNIONS
    for (int k = 0; k < N_QUATERNIONS; ++k) {
        double *e = x + quaternions[k][1];
        const double size = 1.0 / sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2] + e[3] * e[3]);
        for (int j = 0; j < 4; ++j)
            e[j] *= size;
    }
#else
    (void)x;
#endif
}

/* Take a step that ends at `stop` at the latest; returns 0 if none is short enough. */
static int take_step(Model *m, double stop, int stop_is_break)
{
    const double t = m->reached, left = stop - t;
    double h = m->next_step, error;
    h = h >= left * (1.0 - 1e-9) ? left : h > 0.5 * left ? 0.5 * left : h;
    int planned = h == m->next_step;
    memcpy(m->begin, m->end, sizeof m->begin);
    m->begun = t;
    if (m->fresh) {
        model_derivatives(m, just_after(t), m->begin, m->slopes[0]);
        m->n_evaluations += 1.0;
    } else {
        memcpy(m->slopes[0], m->slopes[12], sizeof m->slopes[0]);
    }
    for (;;) {
        error = try_step(m, h);
        if (error <= m->p[TOLERANCE])
            break;
        h *= fmin(step_factor(error, m->p[TOLERANCE]), 0.9);
        planned = 1;
        if (!(h > 1e-14 * fabs(t) && h > 1e-300)) {
            memcpy(m->end, m->begin, sizeof m->end);
            return 0;
        }
    }
    m->reached = h == left ? stop : t + h;
    /* At the limit of stability the highest mode would be excited, and then hold the steps far below it; up to
       LONGEST_STEP the method damps it. */
    if (planned)
        m->next_step = fmin(h * step_factor(error, m->p[TOLERANCE]), LONGEST_STEP);
    keep_largest(m->largest, m->end);
    settle(m->end);
    m->fresh = N_QUATERNIONS > 0;
    m->prepared = 0;
    m->n_steps += 1.0;
    if (stop_is_break && m->reached == stop) {
        ++m->done;
        m->fresh = 1;
    }
    return 1;
}

/* Interpolate the last step; its coefficients take three more evaluations, once. */
static void interpolate(Model *m, double time, double *x)
{
    const double h = m->reached - m->begun, part = (time - m->begun) / h;
    if (!m->prepared) {
        double stage[N_STATES];
        for (int k = 13; k < 16; ++k) {
            SUM(k)(h, m->slopes, m->begin, stage);
            model_derivatives(m, m->begun + stage_times[k] * h, stage, m->slopes[k]);
        }
        m->n_evaluations += 3.0;
        for (int i = 0; i < N_STATES; ++i) {
            const double rise = m->end[i] - m->begin[i];
            m->dense[0][i] = rise;
            m->dense[1][i] = h * m->slopes[0][i] - rise;
            m->dense[2][i] = 2.0 * rise - h * (m->slopes[12][i] + m->slopes[0][i]);
        }
        for (int k = 0; k < 4; ++k)
            SUM(DENSE + k)(h, m->slopes, zeros, m->dense[3 + k]);
        m->prepared = 1;
    }
    for (int i = 0; i < N_STATES; ++i) {
        double total = m->dense[6][i] * part;
        for (int k = 5; k >= 0; --k)
            total = (total + m->dense[k][i]) * (k % 2 ? 1.0 - part : part);
        x[i] = m->begin[i] + total;
    }
    settle(x);
}

static void stop_there(Model *m)
{
    m->time = m->reached;
    memcpy(m->x, m->end, sizeof m->x);
    m->restart = 1;
}

Advance model_advance(Model *m, double target)
{
    const int restarted = m->restart;
    if (restarted) {
        memcpy(m->end, m->x, sizeof m->end);
        settle(m->end);
        keep_largest(m->largest, m->end);
        m->reached = m->begun = m->time;
        model_pass_breakpoints(m);
        m->done = m->passed;
        m->fresh = 1;
        m->restart = 0;
    }
    const double begun = m->reached, counted = m->n_steps;
    while (m->reached < target) {
        const double taken = m->n_steps - counted;
        if (taken >= SEEN_STEPS && (target - m->reached) * taken > (MOST_STEPS - taken) * (m->reached - begun)) {
            stop_there(m);
            return TOO_MANY_STEPS;
        }
        double stop = breakpoints[m->done];
        int is_break = 1;
        if (restarted && !m->steady && target < stop) { /* something is set at each call: to go beyond would be lost */
            stop = target;
            is_break = 0;
        }
        if (!take_step(m, stop, is_break)) {
            stop_there(m);
            return STEP_TOO_SMALL;
        }
    }
    m->steady = !restarted;
    if (m->reached > target)
        interpolate(m, target, m->x);
    else
        memcpy(m->x, m->end, sizeof m->x);
    m->time = target;
    model_pass_breakpoints(m);
    return ADVANCED;
}
