/*
 * Rigid robots with dry friction under control: one call runs a whole experiment.
 *
 *     M(q) ddq + c(q, dq) + F = tau,   F by mode: +1, -1 (sliding), 0 (held)
 *     dz/dt = dq - |dq| z / |z_e(dq)|   bristles;   z = clamp(z_k + way, -+ z_e)   elements
 *
 * Equations, modes and events are those of symid/simulation/rigid_plant.py, which explains them, in the same order
 * of operations. Steps are those of Runge and Kutta (bristles: Cox and Matthews); where friction is curved, has a
 * state, or `controlled` says so, they are as long as their error allows. Where that takes too many of them, because
 * friction stops a joint much sooner than the robot moves, steps are linearly implicit in friction:
 *
 *     (M / (g h) + D) u_i = M (f(y + sum a_ij u_j) + sum c_ij u_j / h),   D = dF/ddq at the step's beginning
 *
 * the method of third order ROS34PW2 (Rang and Angermann, BIT 45 (2005) 761-787), L-stable, whose order does not
 * depend on D. No function allocates memory or keeps state. Matrices are row-major.
 */
#include "plant_calls.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

/* n coordinates, m deflections z; flags are 0 or 1. Lines of friction have rows of standstill, ahead, back. */
typedef struct {
    size_t n, m, curves, varies, controlled;
    forward_call forward;
    mass_call mass;
    bias_call bias;
    plant_friction friction;
    const double *beta;
    const double *viscous, *level;             /* 3 x n */
    const double *curved, *varying, *bristled; /* n */
    const double *owner, *stiffness, *element; /* m */
} rigid_robot;

/* References are ticks x n; gains, limits, encoder steps (0: perfect) and the largest distance from the reference n. */
typedef struct {
    size_t ticks, substeps, sensed;
    double period, blend; /* blend: of the low-pass of velocities */
    const double *position, *speed, *torque;
    const double *stiffness, *damping, *limit, *step, *reach;
} rigid_order;

/* All ticks x n but deflections z, ticks x m, and sums since the start, ticks, J; `end`: why it ended, events. */
typedef struct {
    double *q, *dq, *torque, *z, *work, *lost, *end;
} rigid_log;

enum { WELL, AWAY, CHATTER, STEEP, UNSETTLED };
enum { MOST_EVENTS = 200, MOST_TURNS = 400, EXPLICIT_STRIDES = 40, IMPLICIT_STRIDES = 20000, IMPLICIT_TICKS = 20 };
enum { STAGES = 4, ROOT_STEPS = 60, SERIES = 10 };
static const double ROOT_TOLERANCE = 1e-13, LEAST_SHARE = 1e-9, SLACK = 1e-9;
static const double STRIDE_ERROR = 1e-7, STRIDE_FLOOR = 1e-10;
static const double NUDGE = 1e-6, LEAST_NUDGE = 1e-12;
static const double STANDSTILL = 1e-300, LONG_WAY = 1e9, NEAR = 0.1;

/* Of the implicit method: g, a_ij, c_ij, and the difference of the result and that of second order. */
static const double DIAGONAL = 4.3586652150845900e-01;
static const double STAGE[STAGES][STAGES] = {
    {0.0},
    {2.0},
    {1.4192173174557652, -0.25923221167296978},
    {4.1847604823191613, -0.28519201735549599, 2.2942803602790423},
};
static const double RATE[STAGES][STAGES] = {
    {0.0},
    {-4.5885607205580836},
    {-4.1847604823191613, 0.28519201735549599},
    {-6.3681792001283597, -6.7956209444668367, 2.8700986043310555},
};
static const double ERROR[STAGES] = {0.277749947647969, -1.4032398951759988, 1.7726301276675507, 0.5};

/* A state: q, dq, mode (n each), z (m), work, lost. */
typedef struct {
    double *x, *y, *trial;                                           /* states */
    double *q, *v, *a[STAGES], *dv[STAGES], *push, *drag, *level;    /* n */
    double *speeds, *ahead, *start, *free, *share, *net, *best;      /* n */
    double *zero, *ones, *way, *felt, *need, *rests, *diagonal;      /* n */
    double *rest[STAGES + 1], *rate, *one, *two, *three, *half;      /* m */
    double *ends, *middle, *z, *after;                               /* m */
    double *uq[STAGES], *uv[STAGES], *uz[STAGES], *slope;            /* n, n, m, n */
    double *torque, *measured, *velocity;                            /* n */
    double *mass, *matrix;                                           /* n x n */
    size_t events, least_events, tries, implicit;
} rigid_scratch;

/* How many numbers of scratch memory a run needs. */
size_t symid_rigid_scratch(size_t n, size_t m)
{
    return 3 * (3 * n + m + 2) + 48 * n + 24 * m + 2 * n * n;
}

static double *take(double **memory, size_t count)
{
    double *part = *memory;
    *memory += count;
    return part;
}

static rigid_scratch divide(const rigid_robot *r, double *memory)
{
    const size_t n = r->n, m = r->m, s = 3 * n + m + 2;
    rigid_scratch w;
    double **states[] = {&w.x, &w.y, &w.trial};
    double **rows[] = {&w.q,     &w.v,     &w.push,  &w.drag, &w.level,    &w.speeds,  &w.ahead, &w.start, &w.free,
                       &w.share, &w.net,   &w.best,  &w.zero, &w.ones,     &w.way,     &w.felt,  &w.need,  &w.rests,
                       &w.diagonal, &w.slope, &w.torque, &w.measured, &w.velocity};
    double **bent[] = {&w.rate, &w.one, &w.two, &w.three, &w.half, &w.ends, &w.middle, &w.z, &w.after};
    for (size_t i = 0; i < sizeof states / sizeof *states; ++i) {
        *states[i] = take(&memory, s);
    }
    for (size_t i = 0; i < sizeof rows / sizeof *rows; ++i) {
        *rows[i] = take(&memory, n);
    }
    for (size_t i = 0; i < sizeof bent / sizeof *bent; ++i) {
        *bent[i] = take(&memory, m);
    }
    for (size_t i = 0; i < STAGES; ++i) {
        w.a[i] = take(&memory, n);
        w.dv[i] = take(&memory, n);
        w.uq[i] = take(&memory, n);
        w.uv[i] = take(&memory, n);
        w.uz[i] = take(&memory, m);
    }
    for (size_t i = 0; i <= STAGES; ++i) {
        w.rest[i] = take(&memory, m);
    }
    w.mass = take(&memory, n * n);
    w.matrix = take(&memory, n * n);
    for (size_t i = 0; i < n; ++i) {
        w.ones[i] = 1.0;
    }
    w.events = w.least_events = w.tries = w.implicit = 0;
    return w;
}

static double sign(double x)
{
    return (double)((x > 0.0) - (x < 0.0));
}

static size_t row(double mode)
{
    return mode > 0.0 ? 1 : (mode < 0.0 ? 2 : 0);
}

/* Friction of joints with deflections, and where these are after a way. */
static void bend(const rigid_robot *r, const rigid_scratch *w, const double *dq, const double *way, const double *z,
                 double *torque, double *after)
{
    const plant_friction *c = &r->friction;
    const double *a[3];
    switch (gather(c, w->zero, w->zero, a)) {
    case 0:
        (void)((step_call_0)c->step)(dq, way, z, c->f, torque, after);
        break;
    case 1:
        (void)((step_call_1)c->step)(dq, way, z, a[0], c->f, torque, after);
        break;
    case 2:
        (void)((step_call_2)c->step)(dq, way, z, a[0], a[1], c->f, torque, after);
        break;
    default:
        (void)((step_call_3)c->step)(dq, way, z, a[0], a[1], a[2], c->f, torque, after);
        break;
    }
}

/* Where deflections end after a long way in the direction of the modes, without sign. */
static void find_ends(const rigid_robot *r, const rigid_scratch *w, const double *dq, const double *mode)
{
    for (size_t i = 0; i < r->n; ++i) {
        w->way[i] = LONG_WAY * mode[i];
    }
    /* Straight ones to begin with. */
    memset(w->after, 0, r->m * sizeof *w->after);
    bend(r, w, dq, w->way, w->after, w->felt, w->ends);
    for (size_t k = 0; k < r->m; ++k) {
        w->ends[k] = fabs(w->ends[k]);
    }
}

static double find_energy(const rigid_robot *r, const double *z)
{
    double sum = 0.0;
    for (size_t k = 0; k < r->m; ++k) {
        sum += r->stiffness[k] * (z[k] * z[k]);
    }
    return 0.5 * sum;
}

/* Friction at speeds other than zero, where torques less friction are the loads. */
static void solve_load(const rigid_robot *r, const rigid_scratch *w, const double *speeds, const double *q,
                       const double *torque, double *found)
{
    find_friction(&r->friction, speeds, q, w->zero, w->free);
    find_friction(&r->friction, speeds, q, w->ones, w->share);
    for (size_t i = 0; i < r->n; ++i) {
        const double rest = torque[i] - w->free[i];
        found[i] = torque[i] - rest / (1.0 + (w->share[i] - w->free[i]) * sign(rest));
    }
}

/* What friction adds to the level of each mode, that of bristles whole; zero at standstill. */
static void find_drag(const rigid_robot *r, const rigid_scratch *w, const double *mode, const double *q,
                      const double *dq, const double *torque, const double *z, double *drag)
{
    const size_t n = r->n;
    for (size_t i = 0; i < n; ++i) {
        drag[i] = r->viscous[row(mode[i]) * n + i] * dq[i];
    }
    if (r->curves) {
        for (size_t i = 0; i < n; ++i) {
            w->felt[i] = r->level[row(mode[i]) * n + i];
            w->speeds[i] = mode[i] * fabs(dq[i]);
        }
        if (r->varies) {
            solve_load(r, w, w->speeds, q, torque, w->ahead);
            for (size_t i = 0; i < n; ++i) {
                w->speeds[i] = mode[i] * STANDSTILL;
            }
            solve_load(r, w, w->speeds, q, torque, w->start);
        } else {
            find_friction(&r->friction, w->speeds, w->felt, w->felt, w->ahead);
        }
        for (size_t i = 0; i < n; ++i) {
            const int varies = r->varying[i] != 0.0, slides = mode[i] != 0.0;
            const double base = varies ? w->start[i] : w->felt[i];
            if (r->curved[i] != 0.0 && slides && dq[i] != 0.0) {
                drag[i] = (mode[i] * dq[i] >= 0.0 ? 1.0 : -1.0) * (w->ahead[i] - base);
            }
            if (varies && slides) {
                drag[i] = base + drag[i];
            }
        }
    }
    if (r->m) {
        bend(r, w, dq, w->zero, z, w->felt, w->after);
        for (size_t i = 0; i < n; ++i) {
            drag[i] += w->felt[i] * r->bristled[i];
        }
    }
}

/* Solve A x = b of k rows, by elimination with pivots; A and b are written to. */
static void solve(double *A, double *b, size_t k)
{
    for (size_t j = 0; j < k; ++j) {
        size_t pivot = j;
        for (size_t i = j + 1; i < k; ++i) {
            pivot = fabs(A[i * k + j]) > fabs(A[pivot * k + j]) ? i : pivot;
        }
        for (size_t i = 0; pivot != j && i < k; ++i) {
            const double kept = A[j * k + i];
            A[j * k + i] = A[pivot * k + i];
            A[pivot * k + i] = kept;
        }
        const double kept = b[j];
        b[j] = b[pivot];
        b[pivot] = kept;
        for (size_t i = j + 1; i < k; ++i) {
            const double factor = A[i * k + j] / A[j * k + j];
            for (size_t l = j + 1; l < k; ++l) {
                A[i * k + l] -= factor * A[j * k + l];
            }
            b[i] -= factor * b[j];
        }
    }
    for (size_t j = k; j-- > 0;) {
        for (size_t l = j + 1; l < k; ++l) {
            b[j] -= A[j * k + l] * b[l];
        }
        b[j] /= A[j * k + j];
    }
}

/* x (n) of the sliding joints, where (M + diagonal) x = b there, and zero of the held ones; `diagonal` or NULL. */
static void solve_free(const rigid_robot *r, const rigid_scratch *w, const double *mode, const double *diagonal,
                       const double *b, double *x)
{
    size_t k = 0, at = 0;
    for (size_t i = 0; i < r->n; ++i) {
        for (size_t j = 0; mode[i] != 0.0 && j < r->n; ++j) {
            if (mode[j] != 0.0) {
                w->matrix[at++] = w->mass[i * r->n + j] + (i == j && diagonal != NULL ? diagonal[i] : 0.0);
            }
        }
        if (mode[i] != 0.0) {
            w->best[k++] = b[i];
        }
    }
    solve(w->matrix, w->best, k);
    for (size_t i = 0, j = 0; i < r->n; ++i) {
        x[i] = mode[i] != 0.0 ? w->best[j++] : 0.0;
    }
}

static void accelerate(const rigid_robot *r, const rigid_scratch *w, const double *mode, const double *q,
                       const double *dq, const double *push, double *ddq)
{
    int held = 0;
    for (size_t i = 0; i < r->n; ++i) {
        held |= mode[i] == 0.0;
    }
    if (!held) {
        (void)r->forward(q, dq, push, r->beta, ddq);
        return;
    }
    (void)r->bias(q, dq, r->beta, w->net);
    (void)r->mass(q, r->beta, w->mass);
    for (size_t i = 0; i < r->n; ++i) {
        w->net[i] = push[i] - w->net[i];
    }
    solve_free(r, w, mode, NULL, w->net, ddq);
}

/* phi_1 = (e^x - 1) / x, phi_2 = (phi_1 - 1) / x and phi_3 = (phi_2 - 1/2) / x. */
static void find_phi(double x, double *one, double *two, double *three)
{
    if (fabs(x) >= NEAR) {
        *one = expm1(x) / x;
        *two = (*one - 1.0) / x;
        *three = (*two - 0.5) / x;
        return;
    }
    double series = 0.0, factorial = 6227020800.0;
    for (int k = SERIES; k >= 0; --k) {
        series = series * x + 1.0 / factorial;
        factorial /= (double)(k + 3);
    }
    *three = series;
    *two = 0.5 + x * series;
    *one = 1.0 + x * (0.5 + x * series);
}

static void find_rest(const rigid_robot *r, const rigid_scratch *w, const double *mode, const double *z, const double *dq,
                      double *rest)
{
    for (size_t k = 0; k < r->m; ++k) {
        const size_t i = (size_t)r->owner[k];
        rest[k] = dq[i] - (mode[i] * dq[i] / w->ends[k] + w->rate[k]) * z[k];
    }
}

/* Before the stages of a step of h from the state x. */
static void begin_bending(const rigid_robot *r, const rigid_scratch *w, const double *x, double h)
{
    const double *dq = x + r->n, *mode = dq + r->n, *z = mode + r->n;
    find_ends(r, w, dq, mode);
    for (size_t k = 0; k < r->m; ++k) {
        const size_t i = (size_t)r->owner[k];
        double one, two, three;
        w->rate[k] = -mode[i] * dq[i] / w->ends[k];
        find_phi(0.5 * h * w->rate[k], &one, &two, &three);
        w->half[k] = 0.5 * h * one;
        find_phi(h * w->rate[k], &w->one[k], &w->two[k], &w->three[k]);
    }
    find_rest(r, w, mode, z, dq, w->rest[0]);
}

/* z at the next of the stages of which `count` are known, where q and dq are. */
static void keep_bending(const rigid_robot *r, const rigid_scratch *w, const double *x, double h, size_t count,
                         const double *q, const double *dq, double *z)
{
    const double *mode = x + 2 * r->n, *before = x + 3 * r->n;
    double *const *rest = w->rest;
    find_ends(r, w, dq, mode);
    for (size_t k = 0; k < r->m; ++k) {
        const size_t i = (size_t)r->owner[k];
        const double decay = exp(0.5 * h * w->rate[k]), two = w->two[k], three = w->three[k];
        double next;
        if (count < 3) {
            next = decay * before[k] + w->half[k] * rest[count - 1][k];
            w->middle[k] = count == 1 ? next : w->middle[k];
        } else if (count == 3) {
            next = decay * w->middle[k] + w->half[k] * (2.0 * rest[2][k] - rest[0][k]);
        } else {
            next = decay * decay * before[k] + h * ((w->one[k] - 3.0 * two + 4.0 * three) * rest[0][k] +
                                                    2.0 * (two - 2.0 * three) * (rest[1][k] + rest[2][k]) +
                                                    (4.0 * three - two) * rest[3][k]);
        }
        z[k] = r->element[k] != 0.0 ? clamp(before[k] + (q[i] - x[i]), w->ends[k]) : next;
    }
    find_rest(r, w, mode, z, dq, w->rest[count]);
}

/* How far an error is beyond what is allowed at a value, the worst so far in `worst`; no number stays. */
static double compare(double worst, double error, double allowed)
{
    const double excess = fabs(error) / allowed;
    return excess > worst || isnan(excess) ? excess : worst;
}

/* The end of a step whose y has the next q, dq and z, and of which friction took `lost`. */
static void finish(const rigid_robot *r, const double *x, const double *torque, double lost, double *y)
{
    const size_t n = r->n, m = r->m;
    double work = 0.0, base = 0.0;
    for (size_t i = 0; i < n; ++i) {
        const double way = y[i] - x[i];
        y[2 * n + i] = x[2 * n + i];
        work += torque[i] * way;
        base += r->level[row(x[2 * n + i]) * n + i] * way;
    }
    if (m) {
        lost -= find_energy(r, y + 3 * n) - find_energy(r, x + 3 * n);
    }
    y[3 * n + m] = x[3 * n + m] + work;
    y[3 * n + m + 1] = x[3 * n + m + 1] + lost + base;
}

/* A step of h from x to y with the modes held; returns its error relative to the one allowed, if `checked`. */
static double stride(const rigid_robot *r, const rigid_scratch *w, const double *x, const double *torque, double h,
                     int checked, double *y)
{
    static const double part[STAGES] = {0.0, 0.5, 0.5, 1.0};
    const size_t n = r->n, m = r->m;
    const double *dq = x + n, *mode = dq + n;
    double power[STAGES];
    if (m) {
        begin_bending(r, w, x, h);
    }
    for (size_t stage = 0; stage <= STAGES; ++stage) {
        double *q = stage < STAGES ? w->q : y, *v = stage < STAGES ? w->v : y + n;
        double *z = stage < STAGES ? w->z : y + 3 * n;
        if (stage == 0) {
            memcpy(q, x, n * sizeof *q);
            memcpy(v, dq, n * sizeof *v);
            memcpy(z, x + 3 * n, m * sizeof *z);
        }
        for (size_t i = 0; stage > 0 && i < n; ++i) {
            if (stage < STAGES) {
                q[i] = x[i] + part[stage] * h * w->dv[stage - 1][i];
                v[i] = dq[i] + part[stage] * h * w->a[stage - 1][i];
            } else {
                q[i] = x[i] + (h / 6.0) * (w->dv[0][i] + 2.0 * (w->dv[1][i] + w->dv[2][i]) + w->dv[3][i]);
                v[i] = dq[i] + (h / 6.0) * (w->a[0][i] + 2.0 * (w->a[1][i] + w->a[2][i]) + w->a[3][i]);
            }
        }
        if (m && stage > 0) {
            keep_bending(r, w, x, h, stage, q, v, z);
        }
        if (stage == STAGES && !checked) {
            break;
        }
        find_drag(r, w, mode, q, v, torque, z, w->drag);
        double sum = 0.0;
        for (size_t i = 0; i < n; ++i) {
            sum += w->drag[i] * v[i];
            w->push[i] = torque[i] - r->level[row(mode[i]) * n + i] - w->drag[i];
        }
        if (stage < STAGES) {
            power[stage] = sum;
            memcpy(w->dv[stage], v, n * sizeof *v);
        }
        accelerate(r, w, mode, q, v, w->push, stage < STAGES ? w->a[stage] : w->slope);
    }
    finish(r, x, torque, (h / 6.0) * (power[0] + 2.0 * (power[1] + power[2]) + power[3]), y);
    double excess = 0.0;
    for (size_t i = 0; checked && i < n; ++i) {
        /* The velocity of third order has w->slope in place of the last stage. */
        const double error = (h / 6.0) * (w->slope[i] - w->a[3][i]);
        excess = compare(excess, error, STRIDE_ERROR * fabs(y[n + i]) + STRIDE_FLOOR);
    }
    for (size_t k = 0; checked && k < m; ++k) {
        if (r->element[k] == 0.0) {
            const double error = h * (4.0 * w->three[k] - w->two[k]) * (w->rest[4][k] - w->rest[3][k]);
            excess = compare(excess, error, STRIDE_ERROR * w->ends[k]);
        }
    }
    return excess;
}

/* The same, linearly implicit in friction; always checked. */
static double stride_implicitly(const rigid_robot *r, const rigid_scratch *w, const double *x, const double *torque,
                                double h, double *y)
{
    const size_t n = r->n, m = r->m;
    const double *dq = x + n, *mode = dq + n, *before = mode + n;
    const double s = 1.0 / (DIAGONAL * h);
    double lost[STAGES];
    /* The slope of friction over speed, of z at rest; falling friction stops nothing. */
    find_drag(r, w, mode, x, dq, torque, before, w->level);
    for (size_t i = 0; i < n; ++i) {
        w->v[i] = dq[i] + (mode[i] < 0.0 ? -1.0 : 1.0) * (NUDGE * fabs(dq[i]) + LEAST_NUDGE);
    }
    find_drag(r, w, mode, x, w->v, torque, before, w->drag);
    for (size_t i = 0; i < n; ++i) {
        const double slope = (w->drag[i] - w->level[i]) / (w->v[i] - dq[i]);
        w->slope[i] = slope > 0.0 ? slope : 0.0;
        w->diagonal[i] = w->slope[i] / s;
    }
    if (m) {
        find_ends(r, w, dq, mode);
    }
    for (size_t k = 0; k < m; ++k) {
        /* dz' = one dv - two dz; of an element dz = dq, unless it slips. */
        const size_t i = (size_t)r->owner[k];
        const int held = fabs(before[k]) < w->ends[k] || mode[i] * before[k] < 0.0;
        w->two[k] = r->element[k] != 0.0 ? 0.0 : mode[i] * dq[i] / w->ends[k];
        w->one[k] = r->element[k] != 0.0 ? (double)held : 1.0 - mode[i] * before[k] / w->ends[k];
        w->three[k] = 1.0 / (s + w->two[k]);
        w->diagonal[i] += r->stiffness[k] * w->one[k] * w->three[k] / s;
    }
    for (size_t stage = 0; stage <= STAGES; ++stage) {
        const double *share = STAGE[stage < STAGES ? stage : STAGES - 1], *rate = RATE[stage < STAGES ? stage : 0];
        double *q = stage < STAGES ? w->q : y, *v = stage < STAGES ? w->v : y + n;
        double *z = stage < STAGES ? w->z : y + 3 * n;
        /* The result is the last stage and what it adds. */
        const size_t known = stage < STAGES ? stage : STAGES;
        for (size_t i = 0; i < n; ++i) {
            q[i] = x[i];
            v[i] = dq[i];
            for (size_t j = 0; j < known; ++j) {
                q[i] += (j < STAGES - 1 ? share[j] : 1.0) * w->uq[j][i];
                v[i] += (j < STAGES - 1 ? share[j] : 1.0) * w->uv[j][i];
            }
        }
        if (m) {
            find_ends(r, w, v, mode);
        }
        for (size_t k = 0; k < m; ++k) {
            const size_t i = (size_t)r->owner[k];
            z[k] = before[k];
            for (size_t j = 0; j < known; ++j) {
                z[k] += (j < STAGES - 1 ? share[j] : 1.0) * w->uz[j][k];
            }
            z[k] = r->element[k] != 0.0 ? clamp(before[k] + (q[i] - x[i]), w->ends[k]) : z[k];
        }
        if (stage == STAGES) {
            break;
        }
        for (size_t k = 0; k < m; ++k) {
            const size_t i = (size_t)r->owner[k];
            w->rest[stage][k] = r->element[k] != 0.0 ? w->one[k] * v[i] : v[i] - mode[i] * v[i] / w->ends[k] * z[k];
            for (size_t j = 0; j < stage; ++j) {
                w->rest[stage][k] += rate[j] / h * w->uz[j][k];
            }
        }
        find_drag(r, w, mode, q, v, torque, z, w->drag);
        lost[stage] = 0.0;
        for (size_t i = 0; i < n; ++i) {
            w->push[i] = torque[i] - r->level[row(mode[i]) * n + i] - w->drag[i];
            lost[stage] += w->drag[i] * v[i];
        }
        accelerate(r, w, mode, q, v, w->push, w->a[stage]);
        for (size_t i = 0; i < n; ++i) {
            w->dv[stage][i] = v[i];
            for (size_t j = 0; j < stage; ++j) {
                w->a[stage][i] += rate[j] / h * w->uv[j][i];
                w->dv[stage][i] += rate[j] / h * w->uq[j][i];
            }
        }
        (void)r->mass(x, r->beta, w->mass);
        for (size_t i = 0; i < n; ++i) {
            w->push[i] = 0.0;
            for (size_t j = 0; j < n; ++j) {
                w->push[i] += w->mass[i * n + j] * w->a[stage][j] / s;
            }
        }
        for (size_t k = 0; k < m; ++k) {
            w->push[(size_t)r->owner[k]] -= r->stiffness[k] * w->rest[stage][k] * w->three[k] / s;
        }
        solve_free(r, w, mode, w->diagonal, w->push, w->uv[stage]);
        for (size_t k = 0; k < m; ++k) {
            const size_t i = (size_t)r->owner[k];
            w->uz[stage][k] = (w->rest[stage][k] + w->one[k] * w->uv[stage][i]) * w->three[k];
            lost[stage] += r->stiffness[k] * dq[i] * w->uz[stage][k];
        }
        for (size_t i = 0; i < n; ++i) {
            w->uq[stage][i] = (w->dv[stage][i] + w->uv[stage][i]) / s;
            lost[stage] += (w->slope[i] * dq[i] + w->level[i]) * w->uv[stage][i];
        }
        for (size_t j = 0; j < stage; ++j) {
            lost[stage] += rate[j] / h * lost[j];
        }
        lost[stage] /= s;
    }
    const double *last = STAGE[STAGES - 1];
    finish(r, x, torque, last[0] * lost[0] + last[1] * lost[1] + last[2] * lost[2] + lost[3], y);
    double excess = 0.0;
    for (size_t i = 0; i < n; ++i) {
        double error = 0.0;
        for (size_t j = 0; j < STAGES; ++j) {
            error += ERROR[j] * w->uv[j][i];
        }
        excess = compare(excess, error, STRIDE_ERROR * fabs(y[n + i]) + STRIDE_FLOOR);
    }
    for (size_t k = 0; k < m; ++k) {
        double error = 0.0;
        for (size_t j = 0; j < STAGES; ++j) {
            error += ERROR[j] * w->uz[j][k];
        }
        excess = compare(excess, r->element[k] != 0.0 ? 0.0 : error, STRIDE_ERROR * w->ends[k]);
    }
    return excess;
}

static double step(const rigid_robot *r, const rigid_scratch *w, const double *x, const double *torque, double h,
                   int checked, double *y)
{
    return w->implicit ? stride_implicitly(r, w, x, torque, h, y) : stride(r, w, x, torque, h, checked, y);
}

/* A step of h at most from w->x to w->y; returns its length, zero where none is short enough, and that of the next. */
static double choose_stride(const rigid_robot *r, rigid_scratch *w, const double *torque, double h, double *next)
{
    const int checked = r->curves || r->m || r->controlled;
    if (!checked) {
        (void)stride(r, w, w->x, torque, h, 0, w->y);
        *next = h;
        return h;
    }
    for (;;) {
        if (++w->tries > EXPLICIT_STRIDES && !w->implicit) {
            w->implicit = IMPLICIT_TICKS;
        } else if (w->tries > IMPLICIT_STRIDES) {
            return 0.0;
        }
        const double excess = step(r, w, w->x, torque, h, 1, w->y);
        /* No number, after a step far too long, is no reason to accept it. */
        const double wanted = 0.9 * pow(excess, w->implicit ? -1.0 / 3.0 : -0.25);
        const double factor = excess > 0.0 ? fmin(4.0, fmax(0.1, wanted)) : 4.0;
        if (excess <= 1.0) {
            *next = factor * h;
            return h;
        }
        h *= isfinite(excess) ? factor : 0.1;
    }
}

/*
 * Choose the modes of joints at rest in w->x: held ones need a torque within their band, others accelerate as they
 * slide. The first violation is exchanged, which ends as M is positive definite. Returns why that failed.
 */
static int settle(const rigid_robot *r, const rigid_scratch *w, const double *torque)
{
    const size_t n = r->n;
    const double *q = w->x, *dq = q + n, *z = q + 3 * n;
    double *mode = w->x + 2 * n;
    int resting = 0;
    for (size_t i = 0; i < n; ++i) {
        w->rests[i] = (double)(mode[i] == 0.0);
        resting |= mode[i] == 0.0;
    }
    if (!resting) {
        return WELL;
    }
    (void)r->mass(q, r->beta, w->mass);
    (void)r->bias(q, dq, r->beta, w->net);
    for (size_t i = 0; i < n; ++i) {
        w->net[i] = torque[i] - w->net[i];
    }
    size_t wrong = 0;
    for (size_t turn = 0; wrong < n && turn < MOST_TURNS; ++turn) {
        wrong = n;
        double better = 0.0;
        find_drag(r, w, mode, q, dq, torque, z, w->drag);
        for (size_t i = 0; i < n; ++i) {
            w->push[i] = w->net[i] - (w->drag[i] + r->level[row(mode[i]) * n + i]);
        }
        solve_free(r, w, mode, NULL, w->push, w->slope);
        for (size_t i = 0; i < n; ++i) {
            w->need[i] = w->net[i];
            for (size_t j = 0; j < n; ++j) {
                w->need[i] -= w->mass[i * n + j] * w->slope[j];
            }
            w->push[i] = torque[i] - w->need[i];
        }
        for (size_t side = 1; r->curves && r->varies && side <= 2; ++side) {
            for (size_t i = 0; i < n; ++i) {
                w->speeds[i] = side == 1 ? STANDSTILL : -STANDSTILL;
            }
            find_friction(&r->friction, w->speeds, q, w->push, side == 1 ? w->ahead : w->start);
        }
        for (size_t i = 0; i < n && wrong == n; ++i) {
            /* Bristles hold with what they are bent: they give way to all else. */
            const int varies = r->varying[i] != 0.0, bends = r->bristled[i] != 0.0;
            const double upper = bends ? w->drag[i] : (varies ? w->ahead[i] : r->level[n + i]);
            const double lower = bends ? w->drag[i] : (varies ? w->start[i] : r->level[2 * n + i]);
            /* A torque this far beyond the band still counts as within it. */
            const double need = w->need[i], slack = SLACK * (fabs(need) + upper - lower);
            const double pushed = (double)((need > upper + slack) - (need < lower - slack));
            better = mode[i] == 0.0 ? pushed : (w->slope[i] * mode[i] < 0.0 ? 0.0 : mode[i]);
            wrong = w->rests[i] != 0.0 && better != mode[i] ? i : n;
        }
        if (wrong < n) {
            mode[wrong] = better;
        }
    }
    for (size_t i = 0; i < n; ++i) {
        mode[i] = mode[i] == 0.0 ? r->bristled[i] : mode[i];
    }
    return wrong < n ? UNSETTLED : WELL;
}

/* The share of the step of h from w->x to w->y at which a joint stops: regula falsi by the Illinois rule. */
static double locate_stop(const rigid_robot *r, const rigid_scratch *w, const double *torque, double h, size_t i)
{
    const double mode = w->x[2 * r->n + i];
    const size_t at = r->n + i;
    double high = 1.0, at_high = w->y[at] * mode, low = 0.0, at_low = w->x[at] * mode;
    /* A joint that has just broken away starts at zero speed: locate where it was sliding. */
    for (double trial = 0.5; at_low <= 0.0 && trial > LEAST_SHARE;) {
        (void)step(r, w, w->x, torque, trial * h, 0, w->trial);
        const double value = w->trial[at] * mode;
        if (value > 0.0) {
            low = trial;
            at_low = value;
        } else {
            high = trial;
            at_high = value;
            trial *= 0.5;
        }
    }
    if (at_low <= 0.0) {
        return high;
    }
    const double scale = fmax(at_low, -at_high);
    double share = high;
    int side = 0;
    for (int k = 0; k < ROOT_STEPS; ++k) {
        share = (low * at_high - high * at_low) / (at_high - at_low);
        (void)step(r, w, w->x, torque, share * h, 0, w->trial);
        const double value = w->trial[at] * mode;
        if (fabs(value) <= ROOT_TOLERANCE * scale) {
            break;
        }
        if (value > 0.0) {
            low = share;
            at_low = value;
            at_high *= side > 0 ? 0.5 : 1.0;
            side = 1;
        } else {
            high = share;
            at_high = value;
            at_low *= side < 0 ? 0.5 : 1.0;
            side = -1;
        }
    }
    return share;
}

/* Take the state that follows from w->x in h s to w->x; returns why that failed. */
static int advance(const rigid_robot *r, rigid_scratch *w, const double *torque, double h)
{
    const size_t n = r->n;
    double left = h, longest = h;
    w->tries = 0;
    while (left > 0.0) {
        if (settle(r, w, torque) != WELL) {
            return UNSETTLED;
        }
        const double taken = choose_stride(r, w, torque, fmin(left, longest), &longest);
        if (taken == 0.0) {
            return STEEP;
        }
        double share = 1.0;
        size_t stopping = n;
        for (size_t i = 0; i < n; ++i) {
            if (w->y[n + i] * w->x[2 * n + i] < 0.0) {
                const double found = locate_stop(r, w, torque, taken, i);
                stopping = stopping == n || found < share ? i : stopping;
                share = stopping == i ? found : share;
            }
        }
        if (stopping < n) {
            (void)step(r, w, w->x, torque, share * taken, 0, w->y);
            w->y[n + stopping] = w->y[2 * n + stopping] = 0.0;
            ++w->events;
        }
        double *before = w->x;
        w->x = w->y;
        w->y = before;
        left *= 1.0 - share * (taken / left);
        if (w->events > w->least_events + MOST_EVENTS) {
            return CHATTER;
        }
    }
    return WELL;
}

/*
 * Run an experiment from `start`: q, dq, modes, the position and the filtered velocity that the controller knows.
 * Each torque holds until the next tick; that of the last tick is written and does nothing. Returns how many ticks
 * were written: fewer than asked for where the robot is out of control or cannot be moved.
 */
size_t symid_rigid_run(const rigid_robot *r, const rigid_order *o, const double *start, double *memory, rigid_log *log)
{
    const size_t n = r->n, m = r->m;
    memset(memory, 0, symid_rigid_scratch(n, m) * sizeof *memory);
    rigid_scratch w = divide(r, memory);
    memcpy(w.x, start, 3 * n * sizeof *start);
    memcpy(w.measured, start + 3 * n, n * sizeof *start);
    memcpy(w.velocity, start + 4 * n, n * sizeof *start);
    int why = WELL;
    size_t k = 0;
    for (; k < o->ticks && why == WELL; ++k) {
        const double *x = w.x;
        for (size_t i = 0, at = k * n; i < n; ++i, ++at) {
            const double before = w.measured[i], asked = o->position[at];
            why = fabs(x[i] - asked) < o->reach[i] && isfinite(x[n + i]) ? why : AWAY;
            w.measured[i] = quantise(x[i], o->step[i]);
            const double raw = o->sensed ? x[n + i] : (w.measured[i] - before) / o->period;
            w.velocity[i] = w.velocity[i] + o->blend * (raw - w.velocity[i]);
            const double pull = o->torque[at] + o->stiffness[i] * (asked - w.measured[i]);
            w.torque[i] = clamp(pull + o->damping[i] * (o->speed[at] - w.velocity[i]), o->limit[i]);
            log->q[at] = x[i];
            log->dq[at] = x[n + i];
            log->torque[at] = w.torque[i];
        }
        memcpy(log->z + k * m, x + 3 * n, m * sizeof *x);
        log->work[k] = x[3 * n + m];
        log->lost[k] = x[3 * n + m + 1];
        w.least_events = w.events;
        for (size_t part = 0; why == WELL && k + 1 < o->ticks && part < o->substeps; ++part) {
            why = advance(r, &w, w.torque, o->period / (double)o->substeps);
        }
        w.implicit -= w.implicit > 0;
    }
    log->end[0] = (double)why;
    log->end[1] = (double)w.events;
    return k;
}
