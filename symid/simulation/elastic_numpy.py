"""The elastic plant without a compiler: the same equations and steps as `templates/c/plant.c`, slower by far.

Input: a library of robot functions, `PlantRobot`, `PlantOrder`. Output: `PlantLog`.

Supported: everything that the compiled plant supports, to rounding.
Not supported: long experiments in reasonable time (several hundred times slower).
"""

from collections.abc import Callable
from typing import final

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.library import Library
from symid.codegen.plant_orders import PlantLog, PlantOrder, PlantRobot

__all__ = ["Springs", "simulate_in_numpy"]

_ROOT_STEPS = 80
_LEAST_SHARE = 1e-9
_LOGGED = ("q", "dq", "theta", "dtheta", "spring", "torque", "work", "friction", "elastic", "damped")


def _clamp(value: float, bound: float) -> float:
    return min(max(value, -bound), bound)


@final
class Springs:
    """The springs of all joints: tau = S(v), v = k0 phi + k3 phi^3 + sum k_i clamp(phi - P_i, r_i)."""

    __slots__ = ("_cubic", "_knees", "_stiffness", "_stops")

    def __init__(self, robot: PlantRobot) -> None:
        """Take the numbers of `robot`; what has no weight or slope is left out."""
        self._stiffness, self._cubic = robot.stiffness.tolist(), robot.cubic.tolist()
        self._stops = [
            [(k, r, w) for k, (r, w) in enumerate(zip(radius, weight, strict=True)) if w]
            for radius, weight in zip(robot.radius.tolist(), robot.weight.tolist(), strict=True)
        ]
        self._knees = [
            [(level, slope) for level, slope in zip(levels, slopes, strict=True) if slope]
            for levels, slopes in zip(robot.knee.tolist(), robot.slope.tolist(), strict=True)
        ]

    def find_inner(self, joint: int, phi: float, play: FloatArray) -> float:
        """Return v, in N m or N, of one joint at torsion `phi` with the plays (n, m) where they are."""
        v = (self._stiffness[joint] + self._cubic[joint] * phi * phi) * phi
        for k, radius, weight in self._stops[joint]:
            v += weight * _clamp(phi - float(play[joint, k]), radius)
        return float(v)

    def find_torque(self, joint: int, phi: float, play: FloatArray) -> float:
        """Return S(v), in N m or N."""
        torque = v = self.find_inner(joint, phi, play)
        for level, slope in self._knees[joint]:
            over = v - level
            if over * level > 0.0:
                torque += slope * over
        return torque

    def integrate(self, joint: int, start: float, end: float, play: FloatArray) -> float:
        """Return the integral of S(v) over phi, in J: Simpson's rule, exact between kinks."""
        total = 0.0
        # A torsion that is no number ends the loop: no comparison with it holds.
        while start < end or start > end:
            kink = self.find_kink(joint, start, end, play)
            middle = self.find_torque(joint, 0.5 * (start + kink), play)
            sides = self.find_torque(joint, start, play) + self.find_torque(joint, kink, play)
            total += (kink - start) / 6.0 * (sides + 4.0 * middle)
            start = kink
        return total

    def find_kink(self, joint: int, start: float, end: float, play: FloatArray) -> float:
        """Return the first torsion from `start` towards `end` at which the slope changes; `end` for none."""
        least, way = _LEAST_SHARE * abs(end - start), 1.0 if end > start else -1.0

        def is_between(kink: float) -> bool:
            return way * (kink - start) > least and way * (end - kink) > least

        for k, radius, _ in self._stops[joint]:
            kink = float(play[joint, k]) + way * radius
            end = kink if is_between(kink) else end
        for level, _ in self._knees[joint]:
            apart = self.find_inner(joint, start, play) - level
            beyond = self.find_inner(joint, end, play) - level
            if apart * beyond < 0.0:
                kink = self._find_level(joint, (start, end), play, level)
                end = kink if is_between(kink) else end
        return end

    def _find_level(self, joint: int, interval: tuple[float, float], play: FloatArray, level: float) -> float:
        """Return where in the interval, without a kink of the stops, v crosses `level`."""
        start, end = interval
        apart = self.find_inner(joint, start, play) - level
        if not self._cubic[joint]:
            return start + (end - start) * apart / (apart - (self.find_inner(joint, end, play) - level))
        low, high = 0.0, 1.0
        for _ in range(_ROOT_STEPS):
            share = 0.5 * (low + high)
            value = self.find_inner(joint, start + share * (end - start), play) - level
            low, high = (share, high) if value * apart > 0.0 else (low, share)
        return start + high * (end - start)


@final
class _Stepper:
    """Runge-Kutta steps; a state is a row each for q, dq, theta, dtheta, lost in friction, damped: (6, n)."""

    def __init__(self, library: Library, robot: PlantRobot) -> None:
        self.springs = Springs(robot)
        self._robot = robot
        self._forward: Callable[..., tuple[FloatArray, ...]] = library.bind("forward_dynamics")
        self._friction = library.bind("friction") if robot.friction.size else None

    def find_springs(self, x: FloatArray, play: FloatArray) -> FloatArray:
        phi = x[2] - x[0]
        pull = [self.springs.find_torque(joint, float(angle), play) for joint, angle in enumerate(phi)]
        torque: FloatArray = np.array(pull) + self._robot.damping * (x[3] - x[1])
        return torque

    def _find_slope(self, x: FloatArray, play: FloatArray, torque: FloatArray) -> FloatArray:
        robot, twist = self._robot, x[3] - x[1]
        drag = np.zeros(robot.size) if self._friction is None else self._friction(x[3], robot.friction)[0]
        push = self.find_springs(x, play)
        (acceleration,) = self._forward(x[0], x[1], push, robot.beta)
        spin = (torque - push - drag) / robot.rotor
        return np.array([x[1], acceleration, x[3], spin, drag * x[3], robot.damping * twist * twist])

    def step(self, x: FloatArray, play: FloatArray, torque: FloatArray, h: float) -> FloatArray:
        k1 = self._find_slope(x, play, torque)
        k2 = self._find_slope(x + 0.5 * h * k1, play, torque)
        k3 = self._find_slope(x + 0.5 * h * k2, play, torque)
        k4 = self._find_slope(x + h * k3, play, torque)
        return x + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)

    def bends(self, x: FloatArray, after: FloatArray, play: FloatArray) -> bool:
        rates = (x[3] - x[1]) * (after[3] - after[1])
        if self._robot.radius.shape[1] and bool(np.any(rates < 0.0)):
            return True
        pairs = zip((x[2] - x[0]).tolist(), (after[2] - after[0]).tolist(), strict=True)
        return any(
            self.springs.find_kink(joint, start, end, play) != end for joint, (start, end) in enumerate(pairs)
        )


def simulate_in_numpy(library: Library, robot: PlantRobot, order: PlantOrder) -> PlantLog:
    """Return what happens to the robot; see `PlantOrder`. To rounding, the numbers of the compiled plant."""
    stepper, size = _Stepper(library, robot), robot.size
    rest = np.zeros(size)
    x = np.array([order.q, rest, order.theta, rest, rest, rest])
    play, work, elastic = order.play.copy(), np.zeros(size), np.zeros(size)
    log = {name: np.zeros((order.ticks, size)) for name in _LOGGED}
    h = order.period / order.substeps

    def settle(after: FloatArray) -> FloatArray:
        start, end = x[2] - x[0], after[2] - after[0]
        work[:] += torque * (after[2] - x[2])
        elastic[:] += [
            stepper.springs.integrate(joint, float(start[joint]), float(end[joint]), play)
            for joint in range(size)
        ]
        play[:] = end[:, None] - np.clip(end[:, None] - play, -robot.radius, robot.radius)
        return after

    for tick in range(order.ticks):
        if not np.all(np.isfinite(x[:4])):
            return PlantLog(**log, ticks=tick)
        torque = _command(order, tick, x)
        row = (x[0], x[1], x[2], x[3], stepper.find_springs(x, play), torque, work, x[4], elastic, x[5])
        for name, values in zip(_LOGGED, row, strict=True):
            log[name][tick] = values
        for _ in range(order.substeps if tick + 1 < order.ticks else 0):
            after = stepper.step(x, play, torque, h)
            if order.parts > 1 and stepper.bends(x, after, play):
                for _ in range(order.parts):
                    x = settle(stepper.step(x, play, torque, h / order.parts))
            else:
                x = settle(after)
    return PlantLog(**log, ticks=order.ticks)


def _command(order: PlantOrder, tick: int, x: FloatArray) -> FloatArray:
    """Return the torque (n,) of the motors' PD loops at a tick."""
    step = np.where(order.step > 0.0, order.step, 1.0)
    seen = np.where(order.step > 0.0, np.round(x[2] / step) * step, x[2])
    demand = order.stiffness * (order.angle[tick] - seen) + order.damping * (order.speed[tick] - x[3])
    torque: FloatArray = np.clip(demand + order.torque[tick], -order.limit, order.limit)
    return torque
