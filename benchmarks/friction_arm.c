/* Revolute joints (JOINTS) under a controller, with dry friction that sticks and slips, or is smooth about rest.
 *
 * Numbers are double, SI units, on the joint side. Links are in modified Denavit-Hartenberg form: the z axis of
 * a link frame is the axis of its joint. A joint slips forwards (mode 1), backwards (-1) or sticks (0). Within
 * one set of modes the motion is smooth and is integrated by Runge-Kutta of fourth order; a step ends where
 * a velocity returns to zero or the friction of a joint at rest is overcome, which bisection finds.
 */
#include <math.h>
#include <string.h>

#ifndef JOINTS
#define JOINTS 6
#endif
enum { N = JOINTS, UNITS = 10, BISECTIONS = 40, MOST_EVENTS = 400 };

static const double SPEED_TOLERANCE = 1e-10; /* rad/s */
static const double LEVEL_TOLERANCE = 1e-10; /* share of the friction at rest */
static const double REFERENCE_TEMPERATURE = 40.0;

typedef struct {
    double turn[9], shift[3]; /* on the link before, at q = 0; rows of the rotation */
    double mass, first[3], inertia[6]; /* about the origin: xx xy xz yy yz zz */
    double rotor;
} Link;

/* s r [C + bump e + (load + load_bump e) |load| + waves] + s [(V + thermal (T - 30)) u + square u |u| + cube u^3],
 * e = exp(-(u / speed)^2), u = s dq; C and V by direction s; r = tanh(u / width), 1 where the width is 0: only
 * then a joint sticks. */
typedef struct {
    double coulomb[2], viscous[2], bump, speed, load, load_bump, cosine[2], sine[2], gear, square, cube, thermal;
    double width;
} Friction;

typedef struct {
    Link link[N];
    Friction friction[N];
    double stiffness[N], damping[N], gravity[3];
    double cold, warm, constant; /* temperature: degrees Celsius at first and at last, s */
} Plant;

typedef struct { double turn[N][9], w[N][3], dw[N][3], a[N][3]; } Motion;
typedef struct { double q[N], dq[N], work; } State;
typedef struct { double ddq[N], torque[N], load[N], left[N]; } Result;

static void cross(const double *a, const double *b, double *c) {
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

static void add_cross(const double *a, const double *b, double *c) {
    double product[3];
    cross(a, b, product);
    for (int k = 0; k < 3; k++) c[k] += product[k];
}

static void turn_out(const double *turn, const double *a, double *b) { /* link to the link before */
    for (int k = 0; k < 3; k++) b[k] = turn[3 * k] * a[0] + turn[3 * k + 1] * a[1] + turn[3 * k + 2] * a[2];
}

static void turn_in(const double *turn, const double *a, double *b) { /* link before to the link */
    for (int k = 0; k < 3; k++) b[k] = turn[k] * a[0] + turn[3 + k] * a[1] + turn[6 + k] * a[2];
}

static void multiply_inertia(const double *inertia, const double *a, double *b) {
    b[0] = inertia[0] * a[0] + inertia[1] * a[1] + inertia[2] * a[2];
    b[1] = inertia[1] * a[0] + inertia[3] * a[1] + inertia[4] * a[2];
    b[2] = inertia[2] * a[0] + inertia[4] * a[1] + inertia[5] * a[2];
}

static void place(const Plant *plant, const double *q, Motion *motion) {
    for (int i = 0; i < N; i++) {
        const double *turn = plant->link[i].turn, c = cos(q[i]), s = sin(q[i]);
        for (int k = 0; k < 3; k++) {
            motion->turn[i][3 * k] = turn[3 * k] * c + turn[3 * k + 1] * s;
            motion->turn[i][3 * k + 1] = turn[3 * k + 1] * c - turn[3 * k] * s;
            motion->turn[i][3 * k + 2] = turn[3 * k + 2];
        }
    }
}

/* Velocities and accelerations of the links from `start` on, those before at rest; gravity where it is given. */
static void move(const Plant *plant, int start, const double *dq, const double *ddq, const double *gravity, Motion *m) {
    double w[3] = {0}, dw[3] = {0}, a[3] = {0}, arm[3];
    for (int k = 0; k < 3 && gravity; k++) a[k] = -gravity[k];
    for (int i = start; i < N; i++) {
        const double *shift = plant->link[i].shift, axis[3] = {0.0, 0.0, dq[i]};
        cross(w, shift, arm);
        add_cross(dw, shift, a);
        add_cross(w, arm, a);
        turn_in(m->turn[i], w, m->w[i]);
        turn_in(m->turn[i], dw, m->dw[i]);
        turn_in(m->turn[i], a, m->a[i]);
        add_cross(m->w[i], axis, m->dw[i]);
        m->w[i][2] += dq[i];
        m->dw[i][2] += ddq[i];
        memcpy(w, m->w[i], sizeof w);
        memcpy(dw, m->dw[i], sizeof dw);
        memcpy(a, m->a[i], sizeof a);
    }
}

static void find_wrench(const Motion *m, int i, double mass, const double *first, const double *inertia,
                        double *force, double *moment) {
    double swing[3], spin[3];
    cross(m->w[i], first, swing);
    for (int k = 0; k < 3; k++) force[k] = mass * m->a[i][k];
    add_cross(m->dw[i], first, force);
    add_cross(m->w[i], swing, force);
    multiply_inertia(inertia, m->dw[i], moment);
    multiply_inertia(inertia, m->w[i], spin);
    add_cross(m->w[i], spin, moment);
    add_cross(first, m->a[i], moment);
}

/* A wrench of link i at the origin of the link before. */
static void carry(const Plant *plant, const Motion *m, int i, double *force, double *moment) {
    double inner[3];
    memcpy(inner, force, sizeof inner);
    turn_out(m->turn[i], inner, force);
    memcpy(inner, moment, sizeof inner);
    turn_out(m->turn[i], inner, moment);
    add_cross(plant->link[i].shift, force, moment);
}

/* Torques of the bodies at the joints from `start` on. */
static void find_torques(const Plant *plant, int start, const Motion *m, double *torque) {
    double force[3] = {0}, moment[3] = {0}, own[3], spin[3];
    for (int i = N - 1; i >= start; i--) {
        const Link *link = &plant->link[i];
        find_wrench(m, i, link->mass, link->first, link->inertia, own, spin);
        for (int k = 0; k < 3; k++) { force[k] += own[k]; moment[k] += spin[k]; }
        torque[i] = moment[2];
        carry(plant, m, i, force, moment);
    }
}

static void find_mass(const Plant *plant, Motion *m, double mass[N][N]) {
    static const double rest[N] = {0};
    for (int j = 0; j < N; j++) {
        double unit[N] = {0}, column[N];
        unit[j] = 1.0;
        move(plant, j, rest, unit, 0, m);
        find_torques(plant, j, m, column);
        for (int i = j; i < N; i++) mass[i][j] = mass[j][i] = column[i];
        mass[j][j] += plant->link[j].rotor;
    }
}

/* Solve the part of the mass matrix whose joints slip, by Cholesky. */
static void solve(double mass[N][N], const int *mode, const double *right, double *ddq) {
    double lower[N][N], y[N];
    int joint[N], count = 0;
    for (int i = 0; i < N; i++) { ddq[i] = 0.0; if (mode[i]) joint[count++] = i; }
    for (int i = 0; i < count; i++) {
        for (int j = 0; j <= i; j++) {
            double sum = mass[joint[i]][joint[j]];
            for (int k = 0; k < j; k++) sum -= lower[i][k] * lower[j][k];
            lower[i][j] = i == j ? sqrt(sum) : sum / lower[j][j];
        }
        y[i] = right[joint[i]];
        for (int k = 0; k < i; k++) y[i] -= lower[i][k] * y[k];
        y[i] /= lower[i][i];
    }
    for (int i = count - 1; i >= 0; i--) {
        for (int k = i + 1; k < count; k++) y[i] -= lower[k][i] * y[k];
        ddq[joint[i]] = y[i] /= lower[i][i];
    }
}

static double find_temperature(const Plant *plant, double time) {
    return plant->warm + (plant->cold - plant->warm) * exp(-time / plant->constant);
}

/* Friction without load in direction s, and its share per torque of the load. */
static double find_friction(const Friction *f, double q, double dq, int s, double temperature, double *share) {
    double u = s * dq, fall = exp(-u * u / (f->speed * f->speed)), level = f->coulomb[s < 0] + f->bump * fall;
    for (int k = 0; k < 2; k++) {
        double angle = (k + 1) * f->gear * q;
        level += f->cosine[k] * cos(angle) + f->sine[k] * sin(angle);
    }
    *share = f->load + f->load_bump * fall;
    if (f->width > 0.0) { double rise = tanh(u / f->width); level *= rise; *share *= rise; }
    level += (f->viscous[s < 0] + f->thermal * (temperature - REFERENCE_TEMPERATURE)) * u;
    return level + f->square * u * fabs(u) + f->cube * u * u * u;
}

/* Accelerations, torques and loads; `left` is what a joint has left until its mode ends, negative beyond. */
static void evaluate(const Plant *plant, const double *reference, double temperature, const State *state,
                     const int *mode, Result *out) {
    static const double rest[N] = {0};
    double mass[N][N], bias[N], right[N], share;
    Motion motion;
    place(plant, state->q, &motion);
    move(plant, 0, state->dq, rest, plant->gravity, &motion);
    find_torques(plant, 0, &motion, bias);
    find_mass(plant, &motion, mass);
    for (int i = 0; i < N; i++) {
        out->torque[i] = reference[2 * N + i] + plant->stiffness[i] * (reference[i] - state->q[i])
            + plant->damping[i] * (reference[N + i] - state->dq[i]);
        if (!mode[i]) continue;
        int smooth = plant->friction[i].width > 0.0, side = smooth ? (state->dq[i] < 0.0 ? -1 : 1) : mode[i];
        double level = find_friction(&plant->friction[i], state->q[i], state->dq[i], side, temperature, &share);
        double driven = out->torque[i] - side * level;
        out->load[i] = driven / (driven * side > 0.0 ? 1.0 + share : 1.0 - share);
        out->left[i] = smooth ? 1.0 : mode[i] * state->dq[i] + SPEED_TOLERANCE;
        right[i] = out->load[i] - bias[i];
    }
    solve(mass, mode, right, out->ddq);
    for (int i = 0; i < N; i++) {
        if (mode[i]) continue;
        out->load[i] = bias[i];
        for (int j = 0; j < N; j++) out->load[i] += mass[i][j] * out->ddq[j];
        double net = out->torque[i] - out->load[i];
        double level = find_friction(&plant->friction[i], state->q[i], 0.0, net < 0.0 ? -1 : 1, temperature, &share);
        out->left[i] = (level + share * fabs(out->load[i])) * (1.0 + LEVEL_TOLERANCE) - fabs(net);
    }
}

/* Reference of the controller (q, dq, torque) at a share x of the interval between two rows. */
static void interpolate(const double *row, double period, double x, double *out) {
    const double *next = row + 3 * N, y = 1.0 - x;
    for (int i = 0; i < N; i++) {
        double rise = next[i] - row[i], here = row[N + i] * period - rise, there = rise - next[N + i] * period;
        out[i] = y * row[i] + x * next[i] + x * y * (y * here + x * there);
        out[N + i] = y * row[N + i] + x * next[N + i];
        out[2 * N + i] = y * row[2 * N + i] + x * next[2 * N + i];
    }
}

typedef struct { const Plant *plant; const double *row; double period, time; } Clock;

static void evaluate_at(const Clock *clock, double since, const State *state, const int *mode, Result *out) {
    double reference[3 * N];
    interpolate(clock->row, clock->period, since / clock->period, reference);
    evaluate(clock->plant, reference, find_temperature(clock->plant, clock->time + since), state, mode, out);
}

static void step(const Clock *clock, double since, double width, const State *from, const int *mode, State *to) {
    static const double part[4] = {0.0, 0.5, 0.5, 1.0}, weight[4] = {1.0, 2.0, 2.0, 1.0};
    State stage = *from, slope = {{0}, {0}, 0.0};
    Result found;
    *to = *from;
    for (int k = 0; k < 4; k++) {
        if (k) {
            for (int i = 0; i < N; i++) {
                stage.q[i] = from->q[i] + part[k] * width * slope.dq[i];
                stage.dq[i] = from->dq[i] + part[k] * width * found.ddq[i];
            }
        }
        evaluate_at(clock, since + part[k] * width, &stage, mode, &found);
        slope.work = 0.0;
        for (int i = 0; i < N; i++) {
            slope.dq[i] = stage.dq[i];
            to->q[i] += weight[k] * width / 6.0 * stage.dq[i];
            to->dq[i] += weight[k] * width / 6.0 * found.ddq[i];
            slope.work += found.load[i] * stage.dq[i];
        }
        to->work += weight[k] * width / 6.0 * slope.work;
    }
}

static double find_least(const Result *found) {
    double least = found->left[0];
    for (int i = 1; i < N; i++) least = fmin(least, found->left[i]);
    return least;
}

/* Set the modes anew where one has ended. */
static void change_modes(const Clock *clock, double since, State *state, int *mode) {
    Result found;
    evaluate_at(clock, since, state, mode, &found);
    for (int i = 0; i < N; i++) {
        if (found.left[i] > 0.0) continue;
        if (mode[i]) {
            mode[i] = 0;
            state->dq[i] = 0.0;
        } else {
            mode[i] = found.torque[i] > found.load[i] ? 1 : -1;
        }
    }
    /* A joint that has just come to rest goes on at once where its friction does not hold it. */
    evaluate_at(clock, since, state, mode, &found);
    for (int i = 0; i < N; i++)
        if (!mode[i] && found.left[i] <= 0.0) mode[i] = found.torque[i] > found.load[i] ? 1 : -1;
}

/* Integrate from `since` over `width`; return how many modes changed, -1 where they change without end. */
static int advance(const Clock *clock, double since, double width, State *state, int *mode) {
    double end = since + width;
    for (int events = 0; events < MOST_EVENTS; events++) {
        State next;
        Result found;
        step(clock, since, end - since, state, mode, &next);
        evaluate_at(clock, end, &next, mode, &found);
        if (find_least(&found) > 0.0) { *state = next; return events; }
        double low = 0.0, high = end - since;
        for (int k = 0; k < BISECTIONS; k++) {
            double middle = 0.5 * (low + high);
            State probe;
            step(clock, since, middle, state, mode, &probe);
            evaluate_at(clock, since + middle, &probe, mode, &found);
            if (find_least(&found) > 0.0) low = middle; else { high = middle; next = probe; }
        }
        *state = next;
        since += high;
        change_modes(clock, since, state, mode);
    }
    return -1;
}

static double find_energy(const Plant *plant, const State *state) {
    double mass[N][N], energy = 0.0, at[3] = {0}, turn[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    Motion motion;
    place(plant, state->q, &motion);
    find_mass(plant, &motion, mass);
    for (int i = 0; i < N; i++) {
        const Link *link = &plant->link[i];
        double before[9], arm[3], first[3];
        for (int j = 0; j < N; j++) energy += 0.5 * state->dq[i] * mass[i][j] * state->dq[j];
        turn_out(turn, link->shift, arm);
        memcpy(before, turn, sizeof before);
        for (int k = 0; k < 9; k++) {
            turn[k] = 0.0;
            for (int l = 0; l < 3; l++) turn[k] += before[k / 3 * 3 + l] * motion.turn[i][3 * l + k % 3];
        }
        turn_out(turn, link->first, first);
        for (int k = 0; k < 3; k++) {
            at[k] += arm[k];
            energy -= plant->gravity[k] * (link->mass * at[k] + first[k]);
        }
    }
    return energy;
}

/* Rows of `out`: q, dq, ddq, torque, load, modes (N each), temperature, energy, work of the loads. Rows of
 * `reference`: q, dq, torque. Where `held`, the controller reads the state once a period and holds its torque; that
 * of a row is the mean of the torques before and behind it. Return the number of changes of mode, -1 where they
 * have no end. */
long simulate(const Plant *plant, long count, int parts, double period, int held, const double *reference,
              double *out) {
    enum { WIDTH = 6 * N + 3 };
    State state = {{0}, {0}, 0.0};
    Plant open = *plant;
    double rows[6 * N] = {0}, torque[N], before[N];
    int mode[N];
    long events = 0;
    for (int i = 0; i < N && held; i++) open.stiffness[i] = open.damping[i] = 0.0;
    for (int i = 0; i < N; i++) {
        state.q[i] = reference[i];
        state.dq[i] = reference[N + i];
        mode[i] = state.dq[i] < 0.0 ? -1 : 1;
    }
    for (long row = 0; row < count; row++) {
        long last = row == count - 1;
        Clock clock = {&open, reference + 3 * N * (row - last), period, (row - last) * period};
        double *to = out + WIDTH * row;
        const double *wanted = reference + 3 * N * row;
        Result found;
        if (held) clock.row = rows;
        for (int i = 0; i < N && held; i++) {
            before[i] = row ? torque[i] : 0.0;
            torque[i] = wanted[2 * N + i] + plant->stiffness[i] * (wanted[i] - state.q[i])
                + plant->damping[i] * (wanted[N + i] - state.dq[i]);
            rows[2 * N + i] = rows[5 * N + i] = row ? 0.5 * (before[i] + torque[i]) : torque[i];
        }
        evaluate_at(&clock, last ? period : 0.0, &state, mode, &found);
        memcpy(to, state.q, sizeof state.q);
        memcpy(to + N, state.dq, sizeof state.dq);
        memcpy(to + 2 * N, found.ddq, sizeof found.ddq);
        memcpy(to + 3 * N, found.torque, sizeof found.torque);
        memcpy(to + 4 * N, found.load, sizeof found.load);
        for (int i = 0; i < N; i++) to[5 * N + i] = mode[i];
        to[6 * N] = find_temperature(plant, row * period);
        to[6 * N + 1] = find_energy(plant, &state);
        to[6 * N + 2] = state.work;
        for (int i = 0; i < N && held; i++) rows[2 * N + i] = rows[5 * N + i] = torque[i];
        for (int k = 0; k < parts && !last; k++) {
            int changes = advance(&clock, period * k / parts, period / parts, &state, mode);
            if (changes < 0) return -1;
            events += changes;
        }
    }
    return events;
}

/* Torques (count, N) of bodies and rotors, without friction. */
void find_inverse_dynamics(const Plant *plant, long count, const double *q, const double *dq, const double *ddq,
                           double *torque) {
    Motion motion;
    for (long row = 0; row < count; row++, q += N, dq += N, ddq += N, torque += N) {
        place(plant, q, &motion);
        move(plant, 0, dq, ddq, plant->gravity, &motion);
        find_torques(plant, 0, &motion, torque);
        for (int i = 0; i < N; i++) torque[i] += plant->link[i].rotor * ddq[i];
    }
}

/* Torques (count, N, N (UNITS + 1)) per unit of mass, first moments, inertia and rotor of every link. */
void find_regressor(const Plant *plant, long count, const double *q, const double *dq, const double *ddq,
                    double *rows) {
    const int width = N * (UNITS + 1);
    Motion motion;
    for (long row = 0; row < count; row++, q += N, dq += N, ddq += N, rows += N * width) {
        place(plant, q, &motion);
        move(plant, 0, dq, ddq, plant->gravity, &motion);
        memset(rows, 0, sizeof(double) * N * width);
        for (int i = 0; i < N; i++) {
            for (int k = 0; k < UNITS; k++) {
                double unit[UNITS] = {0}, force[3], moment[3];
                unit[k] = 1.0;
                find_wrench(&motion, i, unit[0], unit + 1, unit + 4, force, moment);
                for (int j = i; j >= 0; j--) {
                    rows[j * width + i * (UNITS + 1) + k] = moment[2];
                    carry(plant, &motion, j, force, moment);
                }
            }
            rows[i * width + i * (UNITS + 1) + UNITS] = ddq[i];
        }
    }
}
