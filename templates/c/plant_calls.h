/*
 * What the plants share: how they call a robot's own functions, of which they get the addresses.
 */
#ifndef SYMID_PLANT_CALLS_H
#define SYMID_PLANT_CALLS_H

#include <math.h>
#include <stddef.h>

typedef int (*forward_call)(const double *q, const double *dq, const double *tau, const double *beta, double *ddq);
typedef int (*mass_call)(const double *q, const double *beta, double *M);
typedef int (*bias_call)(const double *q, const double *dq, const double *beta, double *c);
/* A function of the robot with as many more arguments as its friction reads. */
typedef void (*any_call)(void);
typedef int (*friction_call_0)(const double *, const double *, double *);
typedef int (*friction_call_1)(const double *, const double *, const double *, double *);
typedef int (*friction_call_2)(const double *, const double *, const double *, const double *, double *);
typedef int (*friction_call_3)(const double *, const double *, const double *, const double *, const double *, double *);
typedef int (*step_call_0)(const double *, const double *, const double *, const double *, double *, double *);
typedef int (*step_call_1)(const double *, const double *, const double *, const double *, const double *, double *, double *);
typedef int (*step_call_2)(const double *, const double *, const double *, const double *, const double *, const double *,
                           double *, double *);
typedef int (*step_call_3)(const double *, const double *, const double *, const double *, const double *, const double *,
                           const double *, double *, double *);

/* Friction of dq, and of what it reads besides: 1 positions, 2 loads, 4 temperatures, or their sum. */
typedef struct {
    any_call friction; /* NULL where there is none */
    any_call step;     /* that of joints with deflections z after a way; NULL without */
    size_t reads;
    const double *temperature, *f;
} plant_friction;

static inline size_t gather(const plant_friction *c, const double *q, const double *load, const double *given[3])
{
    size_t count = 0;
    if (c->reads & 1u) {
        given[count++] = q;
    }
    if (c->reads & 2u) {
        given[count++] = load;
    }
    if (c->reads & 4u) {
        given[count++] = c->temperature;
    }
    return count;
}

static inline void find_friction(const plant_friction *c, const double *dq, const double *q, const double *load, double *torque)
{
    const double *a[3];
    switch (gather(c, q, load, a)) {
    case 0:
        (void)((friction_call_0)c->friction)(dq, c->f, torque);
        break;
    case 1:
        (void)((friction_call_1)c->friction)(dq, a[0], c->f, torque);
        break;
    case 2:
        (void)((friction_call_2)c->friction)(dq, a[0], a[1], c->f, torque);
        break;
    default:
        (void)((friction_call_3)c->friction)(dq, a[0], a[1], a[2], c->f, torque);
        break;
    }
}

static inline double quantise(double x, double step)
{
    return step > 0.0 ? rint(x / step) * step : x;
}

static inline double clamp(double x, double r)
{
    return x > r ? r : (x < -r ? -r : x);
}

#endif
