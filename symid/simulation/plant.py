"""A rigid robot with dry friction, moved by torques that hold between control ticks.

Input: a library of robot functions, a state, a torque held for some time. Output: the next state.

    M(q) ddq + c(q, dq) + tau_f = tau,   tau_f by mode: +1, -1 (sliding), 0 (held)

Steps are classical Runge-Kutta with fixed modes. Where a sliding velocity crosses zero, the
step is cut at the crossing, and the modes are chosen anew. Work and dissipation are
integrated along, so that work = change of energy + dissipation can be checked.

Where friction is curved, steps are shortened until the velocity agrees with that of the third-order formula
of the same stages, dq + h/6 (a1 + 2 a2 + 2 a3 + a5), a5 at the end of the step: as short as a steep zone
around standstill asks for, and the whole step beyond it.

Supported: any number of joints, several held at once; friction that is steep within limits.
Not supported: elastic joints, contact, position limits. Break-away of a held joint is looked for
at the beginning of each step, not within it (a held joint does no work).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.library import Library
from symid.errors import Notice, SolverError
from symid.simulation.friction import FrictionLines, check_speeds, find_friction_lines, find_values

__all__ = ["Plant", "PlantState", "start_state"]

Modes = tuple[int, ...]
Derivative = tuple[FloatArray, FloatArray, float]

_MOST_EVENTS = 200
_ROOT_STEPS = 60
_ROOT_TOLERANCE = 1e-13
_LEAST_SHARE = 1e-9
_SLACK = 1e-9
_MOST_STRIDES = 500
"""Tries of a step within one substep: what friction needs that stops a joint at 1e6 / s within 1 ms."""
_STRIDE_ERROR = 1e-7
"""Of the velocity, in one step of the third-order formula; that of the step itself is far smaller."""
_STRIDE_FLOOR = 1e-10
"""Errors of the velocity below this, rad/s or m/s, are none."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlantState:
    """Where the robot is. Arrays are never written to after they stand here.

    Args:
        q, dq: (n,) rad or m, rad/s or m/s. modes: friction mode of each joint, see the module.
        work: J, done by the torques so far. dissipation: J, lost in friction so far.
        events: how often a joint came to rest or turned so far.
    """

    q: FloatArray
    dq: FloatArray
    modes: Modes
    work: float = 0.0
    dissipation: float = 0.0
    events: int = 0


def start_state(q: FloatArray) -> PlantState:
    """Return the state at rest at `q` (n,)."""
    return PlantState(q=np.array(q, dtype=np.float64), dq=np.zeros(len(q)), modes=(0,) * len(q))


@final
class Plant:
    """The solver: robot functions bound once, parameter values, friction lines."""

    __slots__ = ("_bias", "_forward", "_joints", "_lines", "_mass", "beta", "size")

    def __init__(self, library: Library, *, speeds: FloatArray | None = None) -> None:
        """Bind the functions of `library`; values are those of its card.

        Args:
            library: the functions of the robot.
            speeds: (n,) rad/s or m/s up to which friction must oppose motion; None for any.

        Raises:
            UsageError: the card lacks a value, or friction is not one that the plant can hold.
        """
        card = library.card
        self.size = card.size
        self._joints = card.joints
        self.beta = find_values(card.beta, card.robot)
        self._lines: FrictionLines = find_friction_lines(library, speeds)
        self._forward: Callable[..., tuple[FloatArray, ...]] = library.bind("forward_dynamics")
        self._mass: Callable[..., tuple[FloatArray, ...]] = library.bind("mass_matrix")
        self._bias: Callable[..., tuple[FloatArray, ...]] = library.bind("bias")

    def advance(
        self, state: PlantState, torque: FloatArray, duration: float, substeps: int = 1
    ) -> PlantState:
        """Return the state after `torque` (n,) was held for `duration` in s.

        Raises:
            SolverError: joints start and stop without end, which a rigid model cannot resolve, or friction
                is so steep that steps become too short.
        """
        step, events, tries = duration / substeps, state.events, 0
        for _ in range(substeps):
            left = longest = step
            while left > 0.0:
                state = self._settle(state, torque)
                after, taken, longest, tried = self._find_stride(state, torque, min(left, longest))
                tries += tried
                share = 1.0
                if any(_has_crossed(joint, state, after) for joint in range(self.size)):
                    share, after = self._locate(state, after, torque, taken)
                state = after
                left *= 1.0 - share * (taken / left)
                if state.events - events > _MOST_EVENTS:
                    raise SolverError(_describe_chatter(state, duration))
                if tries > _MOST_STRIDES * substeps:
                    raise SolverError(self._describe_steep(duration))
        return state

    def _find_stride(
        self, state: PlantState, torque: FloatArray, h: float
    ) -> tuple[PlantState, float, float, int]:
        """Return the state after a step of `h` at most, its length, that of the next, how many were tried."""
        if self._lines.curve is None:
            return self._step(state, torque, h), h, h, 1
        for tries in range(1, _MOST_STRIDES + 1):
            with np.errstate(over="ignore", invalid="ignore"):
                after, last = self._stride(state, torque, h)
                excess = self._find_excess(after, last, torque, h)
            # No number, after a step far too long, is no reason to accept it.
            factor = min(4.0, max(0.1, 0.9 * excess**-0.25)) if excess > 0.0 else 4.0
            if excess <= 1.0:
                return after, h, factor * h, tries
            h *= factor if math.isfinite(excess) else 0.1
        return after, h, h, _MOST_STRIDES

    def _find_excess(self, after: PlantState, last: FloatArray, torque: FloatArray, h: float) -> float:
        """Return the error of the velocities after a step, relative to the one allowed."""
        held = [joint for joint, mode in enumerate(after.modes) if mode == 0]
        level = self._lines.level[np.array(after.modes), np.arange(self.size)]
        push = torque - level - self._lines.find_drag(after.modes, after.dq)
        error = (h / 6.0) * np.abs(self._accelerate(after.q, after.dq, push, held) - last)
        return float(np.max(error / (_STRIDE_ERROR * np.abs(after.dq) + _STRIDE_FLOOR)))

    def check_friction(self, dq: FloatArray) -> None:
        """Refuse friction that drove a joint at velocities dq (N, n), rad/s or m/s.

        Raises:
            UsageError: which joints, and from what speed on.
        """
        check_speeds(self._lines, self._joints, dq)

    def find_weight(self, q: FloatArray) -> FloatArray:
        """Return the torque (n,) in N m or N that holds the robot at rest at `q` (n,)."""
        return self._bias(np.asarray(q, dtype=np.float64), np.zeros(self.size), self.beta)[0].copy()

    def _step(self, state: PlantState, torque: FloatArray, h: float) -> PlantState:
        """Return the state after one Runge-Kutta step with the modes held."""
        return self._stride(state, torque, h)[0]

    def _stride(self, state: PlantState, torque: FloatArray, h: float) -> tuple[PlantState, FloatArray]:
        """Return the state after one Runge-Kutta step with the modes held, and its last stage's ddq (n,)."""
        rows = np.array(state.modes)
        columns = np.arange(self.size)
        level = self._lines.level[rows, columns]
        push = torque - level
        held = [joint for joint, mode in enumerate(state.modes) if mode == 0]

        def slope(q: FloatArray, dq: FloatArray) -> Derivative:
            drag = self._lines.find_drag(state.modes, dq)
            return dq, self._accelerate(q, dq, push - drag, held), float(drag @ dq)

        q, dq = state.q, state.dq
        v1, a1, p1 = slope(q, dq)
        v2, a2, p2 = slope(q + 0.5 * h * v1, dq + 0.5 * h * a1)
        v3, a3, p3 = slope(q + 0.5 * h * v2, dq + 0.5 * h * a2)
        v4, a4, p4 = slope(q + h * v3, dq + h * a3)
        move = (h / 6.0) * (v1 + 2.0 * (v2 + v3) + v4)
        lost = (h / 6.0) * (p1 + 2.0 * (p2 + p3) + p4)
        after = PlantState(
            q=q + move,
            dq=dq + (h / 6.0) * (a1 + 2.0 * (a2 + a3) + a4),
            modes=state.modes,
            work=state.work + float(torque @ move),
            dissipation=state.dissipation + lost + float(level @ move),
            events=state.events,
        )
        return after, a4

    def _describe_steep(self, duration: float) -> Notice:
        lines = self._lines
        creeps = lines.curved & (lines.level[1] <= lines.level[2])
        found = creeps if creeps.any() else lines.curved
        names = [joint.name for joint, steep in zip(self._joints, found, strict=True) if steep]
        text = (
            f"the friction of {' or '.join(map(repr, names))} rises so steeply around standstill that "
            f"{_MOST_STRIDES} steps within {duration:g} s do not follow it; widen the zone in which it "
            "changes its sign (dq0, smoothing; lower g2, g3, g5), or take a model that jumps there, as "
            "stribeck does"
        )
        return Notice(code="simulate.steep-friction", text=text)

    def _accelerate(self, q: FloatArray, dq: FloatArray, push: FloatArray, held: list[int]) -> FloatArray:
        """Return ddq (n,) under `push` (n,), torque less friction; zero at held joints."""
        if not held:
            return self._forward(q, dq, push, self.beta)[0].copy()
        acceleration = np.zeros(self.size)
        free = [joint for joint in range(self.size) if joint not in held]
        if free:
            net = push - self._bias(q, dq, self.beta)[0]
            mass = self._mass(q, self.beta)[0]
            acceleration[free] = np.linalg.solve(mass[np.ix_(free, free)], net[free])
        return acceleration

    def _settle(self, state: PlantState, torque: FloatArray) -> PlantState:
        """Return the state with modes chosen for the joints that stand still.

        A complementarity problem: a held joint needs a friction torque within its band, one that
        breaks away must accelerate in the direction it slides. Solved by exchanging the first joint
        that violates this, which ends because the mass matrix is positive definite (Murty 1974).
        """
        resting = [joint for joint, mode in enumerate(state.modes) if mode == 0]
        if not resting:
            return state
        modes, columns = list(state.modes), np.arange(self.size)
        mass = self._mass(state.q, self.beta)[0].copy()
        net = torque - self._bias(state.q, state.dq, self.beta)[0]
        for _ in range(4 * 3 ** len(resting)):
            rows = np.array(modes)
            friction = self._lines.find_drag(modes, state.dq) + self._lines.level[rows, columns]
            held = [joint for joint, mode in enumerate(modes) if mode == 0]
            free = [joint for joint, mode in enumerate(modes) if mode != 0]
            acceleration = np.zeros(self.size)
            if free:
                acceleration[free] = np.linalg.solve(mass[np.ix_(free, free)], (net - friction)[free])
            need = net - mass @ acceleration
            change = self._find_violation(resting, held, need, acceleration, modes)
            if change is None:
                break
            modes[change[0]] = change[1]
        return replace(state, modes=tuple(modes))

    def _find_violation(
        self,
        resting: list[int],
        held: list[int],
        need: FloatArray,
        acceleration: FloatArray,
        modes: list[int],
    ) -> tuple[int, int] | None:
        """Return the first resting joint whose mode is wrong, and its better mode."""
        level = self._lines.level
        for joint in resting:
            if joint in held:
                slack = _find_slack(level[:, joint], float(need[joint]))
                if need[joint] > level[1, joint] + slack:
                    return joint, 1
                if need[joint] < level[2, joint] - slack:
                    return joint, -1
            elif acceleration[joint] * modes[joint] < 0.0:
                return joint, 0
        return None

    def _locate(
        self, before: PlantState, after: PlantState, torque: FloatArray, h: float
    ) -> tuple[float, PlantState]:
        """Return the share of the step at which the first joint stops, and the state there, at rest."""
        share, stopping = min(
            (self._find_stop(joint, before, after, torque, h), joint)
            for joint in range(self.size)
            if _has_crossed(joint, before, after)
        )
        there = self._step(before, torque, share * h)
        dq, modes = there.dq.copy(), list(there.modes)
        dq[stopping], modes[stopping] = 0.0, 0
        return share, replace(there, dq=dq, modes=tuple(modes), events=there.events + 1)

    def _find_stop(
        self, joint: int, before: PlantState, after: PlantState, torque: FloatArray, h: float
    ) -> float:
        """Return the share of the step at which `joint` stops: regula falsi by the Illinois rule."""
        mode = before.modes[joint]

        def speed(share: float) -> float:
            return float(self._step(before, torque, share * h).dq[joint]) * mode

        high, at_high = 1.0, float(after.dq[joint]) * mode
        low, at_low = 0.0, float(before.dq[joint]) * mode
        # A joint that has just broken away starts at zero speed: look for where it was sliding.
        trial = 0.5
        while at_low <= 0.0 and trial > _LEAST_SHARE:
            value = speed(trial)
            if value > 0.0:
                low, at_low = trial, value
            else:
                high, at_high, trial = trial, value, 0.5 * trial
        if at_low <= 0.0:
            return high
        scale, side = max(at_low, -at_high), 0
        for _ in range(_ROOT_STEPS):
            share = (low * at_high - high * at_low) / (at_high - at_low)
            value = speed(share)
            if abs(value) <= _ROOT_TOLERANCE * scale:
                break
            if value > 0.0:
                low, at_low = share, value
                at_high, side = (0.5 * at_high if side > 0 else at_high), 1
            else:
                high, at_high = share, value
                at_low, side = (0.5 * at_low if side < 0 else at_low), -1
        return share


def _has_crossed(joint: int, before: PlantState, after: PlantState) -> bool:
    return float(after.dq[joint]) * before.modes[joint] < 0.0


def _find_slack(level: FloatArray, need: float) -> float:
    """Return how far a needed torque may lie beyond the band and still count as within it."""
    return _SLACK * (abs(need) + float(level[1]) - float(level[2]))


def _describe_chatter(state: PlantState, duration: float) -> Notice:
    text = (
        f"joints came to rest more than {_MOST_EVENTS} times within {duration:g} s, "
        f"at q = {state.q.tolist()}; the control gains are too high for this control period, "
        "or the friction values too large"
    )
    return Notice(code="simulate.chatter", text=text)
