/*
 * Elastic robots under control: one call runs a whole experiment.
 *
 *     M(q) ddq + c(q, dq) = tau_J,   B ddtheta + F(dtheta) + tau_J = tau,   phi = theta - q
 *     tau_J = S(v) + D dphi,   v = k0 phi + k3 phi^3 + sum k_i clamp(phi - P_i, r_i)
 *
 * Classical Runge-Kutta steps with the plays P_i frozen inside a step and moved after it. A step within which the
 * slope of a spring changes, or its torsion turns, is taken again in `parts` pieces: there the error is largest.
 * Springs of other kinds come as a function of torsion, rate and time since the step began; its states stand where
 * the plays of stops would, and where its slope changes is not looked for.
 *
 * The robot's own functions come as pointers, so that this file is the same for every robot. No function allocates
 * memory or keeps state. Matrices are row-major.
 */
#include "plant_calls.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

/* The torque of joint i whose torsion has gone to held[0] in held[1] s, at a rate of held[2], from its m states. */
typedef double (*element_call)(size_t i, const double *held, const double *states, double *after);

/*
 * n joints with m stops and l knees each; those that a joint lacks have a weight or slope of zero. With `element`
 * the tables of springs do not count, but damping, and m is the largest number of states.
 */
typedef struct {
    size_t n, m, l;
    element_call element; /* NULL: stops and knees */
    forward_call forward;
    plant_friction friction;
    const double *beta;
    const double *rotor, *stiffness, *cubic, *damping; /* n */
    const double *radius, *weight;                     /* n x m */
    const double *knee, *slope;                        /* n x l */
} plant_robot;

/* References are ticks x n; gains, limits and encoder steps n (a step of 0: a perfect encoder). */
typedef struct {
    size_t ticks, substeps, parts;
    double period;
    const double *angle, *speed, *torque;
    const double *stiffness, *damping, *limit, *step;
} plant_order;

/* All ticks x n; the last four sum up since the start, J. */
typedef struct {
    double *q, *dq, *theta, *dtheta, *spring, *torque;
    double *work, *friction, *elastic, *damped;
} plant_log;

/* The state x holds q, dq, theta, dtheta, and what friction and damping took: 6 n numbers. */
typedef struct {
    double *x, *before, *y, *k1, *k2, *k3, *k4;
    double *play, *after, *push, *drag, *work, *elastic;
} plant_scratch;

enum { STATES = 6, ROOT_STEPS = 80 };
static const double LEAST_SHARE = 1e-9;

/* How many numbers of scratch memory a run needs. */
size_t symid_plant_scratch(size_t n, size_t m)
{
    return 7 * STATES * n + (n + 1) * m + 4 * n;
}

static plant_scratch divide(const plant_robot *r, double *memory)
{
    const size_t n = r->n, s = STATES * n;
    plant_scratch w;
    double **states[] = {&w.x, &w.before, &w.y, &w.k1, &w.k2, &w.k3, &w.k4};
    double **vectors[] = {&w.push, &w.drag, &w.work, &w.elastic};
    for (size_t i = 0; i < sizeof states / sizeof *states; ++i, memory += s) {
        *states[i] = memory;
    }
    for (size_t i = 0; i < sizeof vectors / sizeof *vectors; ++i, memory += n) {
        *vectors[i] = memory;
    }
    w.play = memory;
    w.after = memory + n * r->m;
    return w;
}

/* v of joint i at torsion phi, the plays where they are. */
static double inner(const plant_robot *r, const double *play, size_t i, double phi)
{
    double v = (r->stiffness[i] + r->cubic[i] * phi * phi) * phi;
    for (size_t j = i * r->m; j < (i + 1) * r->m; ++j) {
        v += r->weight[j] * clamp(phi - play[j], r->radius[j]);
    }
    return v;
}

/* S(v) of joint i. */
static double outer(const plant_robot *r, size_t i, double v)
{
    double torque = v;
    for (size_t j = i * r->l; j < (i + 1) * r->l; ++j) {
        const double over = v - r->knee[j];
        if (r->knee[j] > 0.0 ? over > 0.0 : over < 0.0) {
            torque += r->slope[j] * over;
        }
    }
    return torque;
}

static double spring(const plant_robot *r, const double *play, size_t i, double phi)
{
    return outer(r, i, inner(r, play, i, phi));
}

/* Where between a and b, of which the latter lies beyond it, v reaches `level`. */
static double find_level(const plant_robot *r, const double *play, size_t i, double a, double b, double level)
{
    const double from = inner(r, play, i, a) - level;
    if (r->cubic[i] == 0.0) {
        /* Between two kinks of the stops v is a straight line. */
        return a + (b - a) * from / (from - (inner(r, play, i, b) - level));
    }
    double low = 0.0, high = 1.0;
    for (int step = 0; step < ROOT_STEPS; ++step) {
        const double share = 0.5 * (low + high);
        const double value = inner(r, play, i, a + share * (b - a)) - level;
        if (value * from > 0.0) {
            low = share;
        } else {
            high = share;
        }
    }
    return a + high * (b - a);
}

/* The first place from a towards b at which the spring's slope changes; b where there is none. */
static double find_kink(const plant_robot *r, const double *play, size_t i, double a, double b)
{
    const double least = LEAST_SHARE * fabs(b - a);
    const double way = b > a ? 1.0 : -1.0;
    double end = b;
    for (size_t j = i * r->m; j < (i + 1) * r->m; ++j) {
        const double kink = play[j] + way * r->radius[j];
        if (r->weight[j] != 0.0 && way * (kink - a) > least && way * (end - kink) > least) {
            end = kink;
        }
    }
    for (size_t j = i * r->l; j < (i + 1) * r->l; ++j) {
        if (r->slope[j] != 0.0) {
            const double from = inner(r, play, i, a) - r->knee[j];
            const double to = inner(r, play, i, end) - r->knee[j];
            if (from * to < 0.0) {
                const double kink = find_level(r, play, i, a, end, r->knee[j]);
                if (way * (kink - a) > least && way * (end - kink) > least) {
                    end = kink;
                }
            }
        }
    }
    return end;
}

/* The integral of S(v) from a to b. Simpson's rule is exact for the cubic polynomials between kinks. */
static double integrate(const plant_robot *r, const double *play, size_t i, double a, double b)
{
    double sum = 0.0;
    while (a < b || a > b) {
        const double end = find_kink(r, play, i, a, b);
        const double middle = spring(r, play, i, 0.5 * (a + end));
        sum += (end - a) / 6.0 * (spring(r, play, i, a) + 4.0 * middle + spring(r, play, i, end));
        a = end;
    }
    return sum;
}

/* The torque of joint i without damping, `passed` s after its memory was as it is; w->after has the next states. */
static double pull(const plant_robot *r, const plant_scratch *w, size_t i, double phi, double rate, double passed)
{
    if (r->element == NULL) {
        return spring(r, w->play, i, phi);
    }
    const double held[3] = {phi, passed, rate};
    return r->element(i, held, w->play + i * r->m, w->after);
}

/* The rates d of the state x, `passed` s after the step began. */
static void find_slope(const plant_robot *r, const plant_scratch *w, const double *torque, const double *x, double passed,
                       double *d)
{
    const size_t n = r->n;
    const double *q = x, *dq = x + n, *theta = x + 2 * n, *dtheta = x + 3 * n;
    for (size_t i = 0; i < n; ++i) {
        const double twist = dtheta[i] - dq[i], damp = r->damping[i] * twist;
        w->push[i] = pull(r, w, i, theta[i] - q[i], twist, passed) + damp;
        d[i] = dq[i];
        d[2 * n + i] = dtheta[i];
        d[5 * n + i] = damp * twist;
    }
    if (r->friction.friction != NULL) {
        find_friction(&r->friction, dtheta, theta, w->push, w->drag);
    }
    for (size_t i = 0; i < n; ++i) {
        d[3 * n + i] = (torque[i] - w->push[i] - w->drag[i]) / r->rotor[i];
        d[4 * n + i] = w->drag[i] * dtheta[i];
    }
    (void)r->forward(q, dq, w->push, r->beta, d + n);
}

/* One Runge-Kutta step from w->before to w->x. */
static void take_step(const plant_robot *r, const plant_scratch *w, const double *torque, double h)
{
    const size_t s = STATES * r->n;
    const double *x = w->before;
    find_slope(r, w, torque, x, 0.0, w->k1);
    for (size_t i = 0; i < s; ++i) {
        w->y[i] = x[i] + 0.5 * h * w->k1[i];
    }
    find_slope(r, w, torque, w->y, 0.5 * h, w->k2);
    for (size_t i = 0; i < s; ++i) {
        w->y[i] = x[i] + 0.5 * h * w->k2[i];
    }
    find_slope(r, w, torque, w->y, 0.5 * h, w->k3);
    for (size_t i = 0; i < s; ++i) {
        w->y[i] = x[i] + h * w->k3[i];
    }
    find_slope(r, w, torque, w->y, h, w->k4);
    for (size_t i = 0; i < s; ++i) {
        w->x[i] = x[i] + h / 6.0 * (w->k1[i] + 2.0 * (w->k2[i] + w->k3[i]) + w->k4[i]);
    }
}

static int bends(const plant_robot *r, const plant_scratch *w)
{
    const size_t n = r->n;
    for (size_t i = 0; i < n; ++i) {
        const double from = w->before[2 * n + i] - w->before[i], to = w->x[2 * n + i] - w->x[i];
        const double rate = w->before[3 * n + i] - w->before[n + i], later = w->x[3 * n + i] - w->x[n + i];
        if ((r->m && rate * later < 0.0) || (r->element == NULL && find_kink(r, w->play, i, from, to) != to)) {
            return 1;
        }
    }
    return 0;
}

/* Count the work of the step of h s from w->before to w->x, then move the plays. */
static void settle(const plant_robot *r, const plant_scratch *w, const double *torque, double h)
{
    const size_t n = r->n;
    for (size_t i = 0; i < n; ++i) {
        const double from = w->before[2 * n + i] - w->before[i], to = w->x[2 * n + i] - w->x[i];
        w->work[i] += torque[i] * (w->x[2 * n + i] - w->before[2 * n + i]);
        if (r->element != NULL) {
            const double rate = w->x[3 * n + i] - w->x[n + i];
            const double ends = pull(r, w, i, from, rate, 0.0) + 4.0 * pull(r, w, i, 0.5 * (from + to), rate, 0.5 * h);
            w->elastic[i] += (to - from) / 6.0 * (ends + pull(r, w, i, to, rate, h));
            memcpy(w->play + i * r->m, w->after, r->m * sizeof *w->after);
            continue;
        }
        w->elastic[i] += integrate(r, w->play, i, from, to);
        for (size_t j = i * r->m; j < (i + 1) * r->m; ++j) {
            w->play[j] = to - clamp(to - w->play[j], r->radius[j]);
        }
    }
    memcpy(w->before, w->x, STATES * n * sizeof *w->x);
}

static void advance(const plant_robot *r, const plant_scratch *w, const double *torque, double h, size_t parts)
{
    take_step(r, w, torque, h);
    if (parts > 1 && bends(r, w)) {
        for (size_t part = 0; part < parts; ++part) {
            take_step(r, w, torque, h / (double)parts);
            settle(r, w, torque, h / (double)parts);
        }
        return;
    }
    settle(r, w, torque, h);
}

/* The torque of joint i at tick k: motor-side PD on the encoder, the speed from the drive's own observer. */
static double command(const plant_order *o, size_t n, size_t k, size_t i, double theta, double dtheta)
{
    const double pull = o->stiffness[i] * (o->angle[k * n + i] - quantise(theta, o->step[i]));
    return clamp(pull + o->damping[i] * (o->speed[k * n + i] - dtheta) + o->torque[k * n + i], o->limit[i]);
}

static void write_log(const plant_robot *r, const plant_order *o, const plant_scratch *w, size_t k, plant_log *log)
{
    const size_t n = r->n;
    const double *x = w->before;
    for (size_t i = 0, at = k * n; i < n; ++i, ++at) {
        log->q[at] = x[i];
        log->dq[at] = x[n + i];
        log->theta[at] = x[2 * n + i];
        log->dtheta[at] = x[3 * n + i];
        log->friction[at] = x[4 * n + i];
        log->damped[at] = x[5 * n + i];
        log->work[at] = w->work[i];
        log->elastic[at] = w->elastic[i];
        const double twist = x[3 * n + i] - x[n + i];
        log->spring[at] = pull(r, w, i, x[2 * n + i] - x[i], twist, 0.0) + r->damping[i] * twist;
        log->torque[at] = command(o, n, k, i, x[2 * n + i], x[3 * n + i]);
    }
}

/*
 * Run an experiment from `start` (q, dq, theta, dtheta) and `play` (n x m). Each torque holds until the next tick;
 * that of the last tick is written and does nothing. Returns how many ticks were written: fewer than asked for
 * where the state is no longer finite.
 */
size_t symid_plant_run(const plant_robot *r, const plant_order *o, const double *start, const double *play, double *memory,
                       plant_log *log)
{
    const plant_scratch w = divide(r, memory);
    const size_t n = r->n;
    memset(memory, 0, symid_plant_scratch(n, r->m) * sizeof *memory);
    memcpy(w.before, start, 4 * n * sizeof *start);
    memcpy(w.play, play, n * r->m * sizeof *play);
    for (size_t k = 0; k < o->ticks; ++k) {
        for (size_t i = 0; i < 4 * n; ++i) {
            if (!isfinite(w.before[i])) {
                return k;
            }
        }
        write_log(r, o, &w, k, log);
        for (size_t step = 0; k + 1 < o->ticks && step < o->substeps; ++step) {
            advance(r, &w, log->torque + k * n, o->period / (double)o->substeps, o->parts);
        }
    }
    return o->ticks;
}
