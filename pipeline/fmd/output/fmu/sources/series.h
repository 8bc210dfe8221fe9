/* A function of time as value, first and second derivative, and what can be done with it. */
#ifndef SERIES_H
#define SERIES_H

#include <math.h>

typedef struct {
    double f, d, dd;
} Series;

static inline Series series_number(double x)
{
    const Series s = {x, 0.0, 0.0};
    return s;
}

static inline Series series_time(double t)
{
    const Series s = {t, 1.0, 0.0};
    return s;
}

static inline Series series_add(Series a, Series b)
{
    const Series s = {a.f + b.f, a.d + b.d, a.dd + b.dd};
    return s;
}

static inline Series series_subtract(Series a, Series b)
{
    const Series s = {a.f - b.f, a.d - b.d, a.dd - b.dd};
    return s;
}

static inline Series series_multiply(Series a, Series b)
{
    const Series s = {a.f * b.f, a.d * b.f + a.f * b.d, a.dd * b.f + 2.0 * a.d * b.d + a.f * b.dd};
    return s;
}

static inline Series series_divide(Series a, Series b)
{
    Series s;
    s.f = a.f / b.f;
    s.d = (a.d - s.f * b.d) / b.f;
    s.dd = (a.dd - 2.0 * s.d * b.d - s.f * b.dd) / b.f;
    return s;
}

/* A function with its derivatives f1 and f2 at a.f; what stands still stays so even where these aren't finite. */
static inline Series series_chain(Series a, double f, double f1, double f2)
{
    Series s = {f, a.d, a.dd};
    if (a.d != 0.0 || a.dd != 0.0) {
        s.d = f1 * a.d;
        s.dd = f2 * a.d * a.d + f1 * a.dd;
    }
    return s;
}

static inline Series series_negate(Series a)
{
    const Series s = {-a.f, -a.d, -a.dd};
    return s;
}

static inline Series series_sin(Series a)
{
    const double s = sin(a.f), c = cos(a.f);
    return series_chain(a, s, c, -s);
}

static inline Series series_cos(Series a)
{
    const double s = sin(a.f), c = cos(a.f);
    return series_chain(a, c, -s, -c);
}

static inline Series series_tan(Series a)
{
    const double f = tan(a.f), f1 = 1.0 + f * f;
    return series_chain(a, f, f1, 2.0 * f * f1);
}

static inline Series series_exp(Series a)
{
    const double f = exp(a.f);
    return series_chain(a, f, f, f);
}

static inline Series series_log(Series a)
{
    return series_chain(a, a.f > 0.0 ? log(a.f) : NAN, 1.0 / a.f, -1.0 / (a.f * a.f));
}

static inline Series series_sqrt(Series a)
{
    const double f = sqrt(a.f);
    return series_chain(a, f, 0.5 / f, -0.25 / (f * a.f));
}

static inline Series series_tanh(Series a)
{
    const double f = tanh(a.f), f1 = 1.0 - f * f;
    return series_chain(a, f, f1, -2.0 * f * f1);
}

static inline Series series_abs(Series a)
{
    return series_chain(a, fabs(a.f), a.f >= 0.0 ? 1.0 : -1.0, 0.0);
}

static inline Series series_minimum(Series a, Series b)
{
    return b.f < a.f || b.f != b.f ? b : a;
}

static inline Series series_maximum(Series a, Series b)
{
    return b.f > a.f || b.f != b.f ? b : a;
}

static inline Series series_before(double t, double at, Series before, Series after)
{
    return t < at ? before : after;
}

static inline Series series_until(double t, double at, Series before, Series after)
{
    return t <= at ? before : after;
}

/* A constant exponent needs no logarithm: the base may be 0 or negative. */
static inline Series series_power(Series a, Series b)
{
    const double x = a.f, n = b.f, f = pow(x, n);
    if (b.d == 0.0 && b.dd == 0.0) {
        const double f1 = n != 0.0 ? n * pow(x, n - 1.0) : 0.0;
        return series_chain(a, f, f1, n == 0.0 || n == 1.0 ? 0.0 : n * (n - 1.0) * pow(x, n - 2.0));
    }
    const double l = x > 0.0 ? log(x) : NAN, over = a.d / x;
    const double slope = b.d * l + n * over;
    const double bend = b.dd * l + 2.0 * b.d * over + n * (a.dd / x - over * over);
    const Series s = {f, f * slope, f * (slope * slope + bend)};
    return s;
}

/* Cubics from each knot on, lowest power first; the first value holds before the first knot. */
static inline Series series_table(double t, int n, const double *knots, const double (*cubics)[4])
{
    if (t < knots[0])
        return series_number(cubics[0][0]);
    int low = 0, high = n;
    while (high - low > 1) {
        const int middle = (low + high) / 2;
        if (knots[middle] <= t)
            low = middle;
        else
            high = middle;
    }
    const double *c = cubics[low], x = t - knots[low];
    const Series s = {
        c[0] + x * (c[1] + x * (c[2] + x * c[3])), c[1] + x * (2.0 * c[2] + 3.0 * x * c[3]), 2.0 * c[2] + 6.0 * x * c[3]
    };
    return s;
}

#endif
