"""The plant of an elastic robot: its values, its rest under its weight, its motion, in C or in NumPy.

Robot and its library's card -> ElasticValues -> PlantRobot. Library, PlantRobot, PlantExperiment -> PlantLog:
compiled where there is a compiler, else by the same equations and steps as templates/c/elastic_plant.c in
NumPy, several hundred times slower. Robots whose friction has a state are computed in NumPy alone, with the
bristles of `rigid_plant`. Springs with branches, backlash or an offset are whole elements, compiled too.

    rest: S(v(phi)) = g,   v on the virgin curve: P_i = sign(phi) max(|phi| - r_i, 0)

Supported: robots all of whose coordinates belong to elastic joints, rotors included; steps short enough for
the fastest motion; springs loaded once from zero.
Not supported: robots that are elastic in part; joints without rotor inertia; dry friction that jumps.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import final

import numpy as np
import scipy

from symid import joint_models
from symid.arrays import FloatArray, FrozenArrays
from symid.codegen import Library, ModelCard, PlantExperiment, PlantLog, PlantRobot
from symid.errors import Notice, SolverError, UsageError
from symid.robot import Robot
from symid.simulation import rigid_plant


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElasticValues(FrozenArrays):
    """Values of all parameters of an elastic robot, in the order of its card.

    Args:
        beta: (p,) of the links. rotor: (n,) kg m^2 or kg. friction: (pf,), motor side.
        elasticity: n springs, all numbers known.
    """

    beta: FloatArray
    rotor: FloatArray
    friction: FloatArray
    elasticity: tuple[joint_models.Elasticity, ...]


def refuse_rigid_joints(robot: Robot) -> None:
    """Raise a UsageError for a robot to be simulated as an elastic one that has rigid joints."""
    names = [joint.name for joint, elastic in zip(robot.axes, robot.elastic, strict=True) if not elastic]
    if names:
        text = f"robot {robot.name!r} cannot be simulated with elastic joints: without [joint.elasticity] "
        text += f"are {', '.join(names)}; give one to all joints or to none"
        raise UsageError(Notice(code="usage.not-elastic", text=text))


def get_elastic_values(robot: Robot, card: ModelCard) -> ElasticValues:
    """Return the values that the robot file states, or raise a UsageError with all reasons why not."""
    refuse_rigid_joints(robot)
    rotors = {rotor.joint: rotor.value for rotor in card.rotors}
    unknown = [entry.name for entry in (*card.beta, *card.rotors, *card.friction) if entry.value is None]
    soft = []
    for joint, spring in zip(robot.axes, card.elasticity, strict=True):
        if joint.name not in rotors:
            unknown.append(f"rotor_inertia of {joint.name!r}")
        if spring is not None and spring.initial_stiffness is None:
            unknown.append(f"stiffness of {joint.name!r} and of its stops")
        if spring is not None and spring.stiffness is not None and spring.stiffness <= 0:
            soft.append(joint.name)
    light = [name for name, value in rotors.items() if value is not None and not value > 0.0]
    # A motor that sticks is not among the plant's modes.
    laws = {joint.name: joint_models.get_friction_law(joint.friction) for joint in robot.axes}
    gentle = {name for name, law in laws.items() if law is not None and law.memory}
    gentle |= {joint.name for joint in robot.joints if joint.friction.smoothing > 0.0}
    gentle |= {coupling.name for coupling in robot.couplings if coupling.friction.smoothing > 0.0}
    dry = [entry for entry in card.friction if entry.name.startswith("Fc") and entry.value]
    sharp = [entry.name for entry in dry if entry.joint not in gentle]
    known = " cannot be simulated: its file states no value for {}; give mass, centre of mass and inertia of "
    known += "every link, rotor inertia, friction and elasticity of every joint"
    smooth = ": the dry friction {} jumps at standstill, which elastic simulation does not support; give "
    smooth += "[joint.friction] a `smoothing` speed, such as 0.01 rad/s"
    rules = (
        (unknown, "unknown-values", known),
        (light, "not-positive", " cannot be simulated: the rotor_inertia of {} must be positive"),
        (soft, "not-positive", " cannot be simulated: the stiffness of {} must be positive"),
        (sharp, "sharp-friction", smooth),
    )
    notices = [
        Notice(code=f"usage.{code}", text=f"robot {robot.name!r}{text.format(', '.join(names))}")
        for names, code, text in rules
        if names
    ]
    if notices:
        raise UsageError(*notices)
    return ElasticValues(
        beta=np.array([parameter.value for parameter in card.beta], dtype=np.float64),
        rotor=np.array([rotors[joint.name] for joint in robot.axes], dtype=np.float64),
        friction=np.array([parameter.value for parameter in card.friction], dtype=np.float64),
        elasticity=tuple(spring for spring in card.elasticity if spring is not None),
    )


def build_plant_robot(values: ElasticValues) -> PlantRobot:
    """Return the numbers as tables; stops and knees that a joint lacks have a weight and slope of zero."""
    springs = values.elasticity
    stops = [[(stop.threshold, stop.stiffness or 0.0) for stop in spring.stops] for spring in springs]
    knees = [[(knee.threshold, knee.slope) for knee in spring.knees] for spring in springs]
    (radius, weight), (knee, slope) = (
        np.array([row + [(1.0, 0.0)] * (max(map(len, rows)) - len(row)) for row in rows])
        .reshape(len(springs), -1, 2)
        .transpose(2, 0, 1)
        for rows in (stops, knees)
    )
    return PlantRobot(
        beta=values.beta,
        friction=values.friction,
        rotor=values.rotor,
        stiffness=np.array([spring.stiffness or 0.0 for spring in springs]),
        cubic=np.array([spring.cubic for spring in springs]),
        damping=np.array([spring.damping for spring in springs]),
        radius=radius,
        weight=weight,
        knee=knee,
        slope=slope,
    )


_SHARE = 0.5
"""Of the time constant of the fastest motion; Runge-Kutta steps are stable up to 2.7 times it."""
_LONGEST_STEP, _SMALL, _ROUNDING = 1e-4, 1e-9, 1e-9
_GROWTH, _MOST_TRIALS, _BISECTIONS, _LEAST_TORSION = 1.1, 400, 200, 1e-9
_ROOT_TOLERANCE, _LEAST_SHARE = 1e-12, 1e-9
_LOGGED = ("q", "dq", "theta", "dtheta", "spring", "torque", "work", "friction", "elastic", "damped")


@final
@dataclass(frozen=True, slots=True)
class Springs:
    """The springs of all joints: tau = S(v), v = k0 phi + k3 phi^3 + sum k_i clamp(phi - P_i, r_i)."""

    robot: PlantRobot

    def compute_inner(
        self, phi: FloatArray | float, play: FloatArray, at: int | slice = slice(None)
    ) -> FloatArray:
        """Return v, in N m or N, of the joints `at` torsion `phi` with the plays (n, m) where they are."""
        robot = self.robot
        slip = np.clip(np.asarray(phi)[..., None] - play[at], -robot.radius[at], robot.radius[at])
        spring = (robot.stiffness[at] + robot.cubic[at] * phi * phi) * phi
        return np.asarray(spring + (robot.weight[at] * slip).sum(axis=-1))

    def compute_torque(
        self, phi: FloatArray | float, play: FloatArray, at: int | slice = slice(None)
    ) -> FloatArray:
        """Return S(v), in N m or N."""
        v, knee = self.compute_inner(phi, play, at), self.robot.knee[at]
        over = v[..., None] - knee
        return np.asarray(v + (self.robot.slope[at] * over * (over * knee > 0.0)).sum(axis=-1))

    def integrate(self, joint: int, start: float, end: float, play: FloatArray) -> float:
        """Return the integral of S(v) over phi, in J: Simpson's rule, exact between kinks."""
        total = 0.0
        # A torsion that is no number ends the loop: no comparison with it holds.
        while start < end or start > end:
            kink = self.locate_kink(joint, start, end, play)
            first, middle, last = (
                float(self.compute_torque(phi, play, joint)) for phi in (start, 0.5 * (start + kink), kink)
            )
            total += (kink - start) / 6.0 * (first + 4.0 * middle + last)
            start = kink
        return total

    def compute(self, phi: FloatArray, _rate: FloatArray, _passed: float, play: FloatArray) -> FloatArray:
        """Return the torques (n,) at torsions (n,); neither their rates nor the time count."""
        return self.compute_torque(phi, play)

    def settle(
        self, ways: tuple[FloatArray, FloatArray], _rate: FloatArray, _passed: float, play: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the work (n,) in J from one torsion (n,) to another, and the plays there."""
        radius, end = self.robot.radius, ways[1][:, None]
        pairs = enumerate(np.stack(ways, axis=1).tolist())
        work = [self.integrate(joint, low, high, play) for joint, (low, high) in pairs]
        return np.array(work), end - np.clip(end - play, -radius, radius)

    def bends(self, start: FloatArray, end: FloatArray, play: FloatArray) -> bool:
        """Return whether a slope changes between torsions (n,)."""
        pairs = enumerate(zip(start.tolist(), end.tolist(), strict=True))
        return any(self.locate_kink(joint, low, high, play) != high for joint, (low, high) in pairs)

    def locate_kink(self, joint: int, start: float, end: float, play: FloatArray) -> float:
        """Return the first torsion from `start` towards `end` at which the slope changes; `end` for none."""
        robot, way, least = self.robot, 1.0 if end > start else -1.0, _LEAST_SHARE * abs(end - start)
        kinks = (play[joint] + way * robot.radius[joint])[robot.weight[joint] != 0.0].tolist()
        for level in robot.knee[joint][robot.slope[joint] != 0.0].tolist():
            ends = [float(self.compute_inner(phi, play, joint)) - level for phi in (start, end)]
            if ends[0] * ends[1] < 0.0:
                kinks.append(
                    scipy.optimize.brentq(
                        lambda phi, level=level: float(self.compute_inner(phi, play, joint)) - level,
                        *sorted((start, end)),
                        xtol=_ROOT_TOLERANCE * abs(end - start),
                    )
                )
        between = [kink for kink in kinks if way * (kink - start) > least and way * (end - kink) > least]
        return min(between, key=lambda kink: way * kink, default=end)


@final
class Elements:
    """The springs of all joints as elements: whatever `Elasticity` holds, its damping apart.

    Their memory (n, m) has the states of each as `start_states` orders them, then zeros.
    """

    def __init__(self, springs: Sequence[joint_models.Elasticity]) -> None:
        """Take the springs, all numbers known."""
        self._algebra = joint_models.build_float_carrier()
        self.springs = tuple(replace(spring, damping=0.0) for spring in springs)
        self._values = [joint_models.list_element_values(spring) for spring in self.springs]
        self._sizes = [len(joint_models.start_states(spring, 0.0)) for spring in self.springs]

    def _advance(
        self, joint: int, torsion: float, motion: tuple[float, float], states: Sequence[float]
    ) -> joint_models.ElementStep[float]:
        rate, passed = motion
        held, spring, before = (torsion, passed), self.springs[joint], states[: self._sizes[joint]]
        return joint_models.advance_element(
            self._algebra, spring, self._values[joint], held, before, velocity=rate
        )

    def load(self, joint: int, torsion: float) -> joint_models.ElementStep[float]:
        """Return where a virgin spring is that has gone slowly from zero to a torsion."""
        return self._advance(joint, torsion, (0.0, 1.0), joint_models.start_states(self.springs[joint], 0.0))

    def pad(self, states: Sequence[Sequence[float]]) -> FloatArray:
        """Return the memory of these states of all joints."""
        memory = np.zeros((len(self._sizes), max(self._sizes)))
        for row, own in zip(memory, states, strict=True):
            row[: len(own)] = own
        return memory

    def compute(self, phi: FloatArray, rate: FloatArray, passed: float, memory: FloatArray) -> FloatArray:
        """Return the torques (n,) at torsions (n,) with rates (n,), `passed` s after the memory was so."""
        motion = enumerate(zip(phi.tolist(), rate.tolist(), memory.tolist(), strict=True))
        return np.array([self._advance(j, at, (v, passed), states).output for j, (at, v, states) in motion])

    def settle(
        self, ways: tuple[FloatArray, FloatArray], rate: FloatArray, passed: float, memory: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the work (n,) in J from torsions (n,) to others, by Simpson's rule, and the states there."""
        start, end = ways
        middle = self.compute(0.5 * (start + end), rate, 0.5 * passed, memory)
        pairs = enumerate(zip(end.tolist(), rate.tolist(), memory.tolist(), strict=True))
        steps = [self._advance(joint, at, (v, passed), states) for joint, (at, v, states) in pairs]
        last = np.array([step.output for step in steps])
        work = (end - start) / 6.0 * (self.compute(start, rate, 0.0, memory) + 4.0 * middle + last)
        return work, self.pad([step.states for step in steps])

    def bends(self, _start: FloatArray, _end: FloatArray, _memory: FloatArray) -> bool:
        """Return False: where branches slip is not located; steps are cut at reversals alone."""
        return False


def build_elements(values: ElasticValues) -> Elements | None:
    """Return the springs as elements, None where all have stops and knees alone."""
    return None if all(spring.is_plain for spring in values.elasticity) else Elements(values.elasticity)


@final
class _ElasticStepper:
    """Runge-Kutta steps; a state is a row each for q, dq, theta, dtheta, lost in friction, damped: (6, n)."""

    def __init__(self, library: Library, robot: PlantRobot, elements: Elements | None) -> None:
        self.springs = elements or Springs(robot)
        self._reverses = elements is not None or robot.radius.shape[1] > 0
        self._robot = robot
        self._forward: Callable[..., tuple[FloatArray, ...]] = library.bind("forward_dynamics")
        self._friction = library.bind("friction") if robot.friction.size else None
        self._card = library.card
        self._bristles = rigid_plant.build_bristles(library, robot.friction)
        # Before and after a step.
        self.z = self.bent = np.zeros(len(self._bristles.owner))

    def compute_springs(self, x: FloatArray, memory: FloatArray, passed: float = 0.0) -> FloatArray:
        rate = x[3] - x[1]
        torque = self.springs.compute(x[2] - x[0], rate, passed, memory)
        return np.asarray(self._robot.damping * rate + torque)

    def _compute_slope(
        self, x: FloatArray, push: FloatArray, torque: FloatArray, z: FloatArray
    ) -> FloatArray:
        robot, twist = self._robot, x[3] - x[1]
        drag = np.zeros(robot.size)
        if self._friction is not None:
            (drag,) = self._friction(*rigid_plant.gather_inputs(self._card, x[3], x[2], push), robot.friction)
        drag = np.where(self._bristles.joints, self._bristles.compute_torque(x[3], z), drag)
        (acceleration,) = self._forward(x[0], x[1], push, robot.beta)
        spin = (torque - push - drag) / robot.rotor
        return np.array([x[1], acceleration, x[3], spin, drag * x[3], robot.damping * twist * twist])

    def step(self, x: FloatArray, memory: FloatArray, torque: FloatArray, h: float) -> FloatArray:
        z, bend = self.z, None
        k1 = self._compute_slope(x, self.compute_springs(x, memory), torque, z)
        if len(z):
            # A motor at rest goes where it is pushed.
            modes = np.where(np.where(x[3] == 0.0, k1[3], x[3]) < 0.0, -1, 1)
            state = rigid_plant.RigidPlantState(q=x[2], dq=x[3], modes=tuple(modes.tolist()), bristles=z)
            bend = rigid_plant.BristleStride(self._bristles, state, h)

        def find_slope(y: FloatArray, passed: float) -> FloatArray:
            bent = z if bend is None else bend.move(y[2] - x[2], y[3])
            return self._compute_slope(y, self.compute_springs(y, memory, passed), torque, bent)

        k2 = find_slope(x + 0.5 * h * k1, 0.5 * h)
        k3 = find_slope(x + 0.5 * h * k2, 0.5 * h)
        k4 = find_slope(x + h * k3, h)
        after: FloatArray = x + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
        if bend is not None:
            self.bent = bend.move(after[2] - x[2], after[3])
        return after

    def bends(self, x: FloatArray, after: FloatArray, memory: FloatArray) -> bool:
        turned = (x[3] * after[3] < 0.0) & self._bristles.joints
        if self._reverses:
            turned |= (x[3] - x[1]) * (after[3] - after[1]) < 0.0
        return bool(np.any(turned)) or self.springs.bends(x[2] - x[0], after[2] - after[0], memory)


def simulate_in_numpy(
    library: Library, robot: PlantRobot, order: PlantExperiment, elements: Elements | None = None
) -> PlantLog:
    """Return the motion of the robot, equal to that of the compiled plant up to rounding.

    `elements` stand in place of the springs of `robot`.
    """
    stepper, size = _ElasticStepper(library, robot, elements), robot.size
    rest = np.zeros(size)
    x = np.array([order.q, rest, order.theta, rest, rest, rest])
    memory = order.play.copy()
    work, elastic = np.zeros(size), np.zeros(size)
    log = {name: np.zeros((order.ticks, size)) for name in _LOGGED}
    h = order.period / order.substeps

    for tick in range(order.ticks):
        if not np.all(np.isfinite(x[:4])):
            return PlantLog(**log, ticks=tick)
        measured = rigid_plant.quantise(x[2], order.step)
        demand = order.stiffness * (order.angle[tick] - measured) + order.damping * (order.speed[tick] - x[3])
        torque: FloatArray = np.clip(demand + order.torque[tick], -order.limit, order.limit)
        row = (x[0], x[1], x[2], x[3], stepper.compute_springs(x, memory), torque, work, x[4], elastic, x[5])
        for name, values in zip(_LOGGED, row, strict=True):
            log[name][tick] = values
        for _ in range(order.substeps if tick + 1 < order.ticks else 0):
            after = stepper.step(x, memory, torque, h)
            pieces = order.parts if order.parts > 1 and stepper.bends(x, after, memory) else 1
            for _ in range(pieces):
                if pieces > 1:
                    after = stepper.step(x, memory, torque, h / pieces)
                work += torque * (after[2] - x[2])
                ways, rate = (x[2] - x[0], after[2] - after[0]), after[3] - after[1]
                done, memory = stepper.springs.settle(ways, rate, h / pieces, memory)
                elastic += done
                x, stepper.z = after, stepper.bent
    return PlantLog(**log, ticks=order.ticks)


def simulate_plant(
    library: Library, robot: PlantRobot, order: PlantExperiment, elements: Elements | None = None
) -> tuple[PlantLog, str, tuple[Notice, ...]]:
    """Return the motion, by the compiled plant where there is one, what computed it, and notices."""
    bends = any(spec.name == "friction_step" for spec in library.card.functions)
    code, notices = rigid_plant.find_compiled_plant(
        library,
        ("forward_dynamics", *(("friction",) if robot.friction.size else ())),
        "elastic",
        springs=() if elements is None else elements.springs,
        lacking="friction has a state" if bends else "",
    )
    if code is None:
        return simulate_in_numpy(library, robot, order, elements), "python", notices
    return code.run(library, robot, order), "c", notices


def count_substeps(library: Library, values: ElasticValues, poses: FloatArray, period: float) -> int:
    """Return the Runge-Kutta steps in a tick of `period` s, each of at most 0.1 ms.

    Fast springs, friction and damping at the poses (K, n), rad or m, shorten the steps.
    """
    # Links and rotors swing against each other, or settle by damping.
    (mass,) = library.evaluate("mass_matrix", poses, values.beta)
    mobility = np.linalg.inv(mass) + np.diag(1.0 / values.rotor)
    root = np.sqrt([joint_models.find_most_slope(spring) for spring in values.elasticity])
    rate = float(np.sqrt(np.linalg.eigvalsh(root[:, None] * mobility * root).max()))
    root = np.sqrt([spring.damping for spring in values.elasticity])
    rate = max(rate, float(np.linalg.eigvalsh(root[:, None] * mobility * root).max()))
    if values.friction.size:
        # Friction stops a rotor.
        speeds = _SMALL * np.vstack([np.eye(len(values.rotor)), -np.eye(len(values.rotor))])
        given = rigid_plant.gather_inputs(library.card, speeds)
        (drag,) = library.evaluate("friction", *given, values.friction)
        bristles, rotor = rigid_plant.build_bristles(library, values.friction), values.rotor
        ahead, back = np.split(drag * ~bristles.joints, 2)
        slope = np.diagonal(ahead - back) / (2.0 * _SMALL)
        # Motors swing or settle on bristles.
        stiffness = np.bincount(bristles.owner, bristles.stiffness, minlength=len(rotor))
        slow, straight = np.full(len(rotor), _SMALL), np.zeros(len(bristles.owner))
        offset = bristles.compute_torque(np.zeros(len(rotor)), straight)
        damping = (bristles.compute_torque(slow, straight) - offset) / _SMALL
        rate = max(rate, float(np.max([np.sqrt(stiffness / rotor), damping / rotor, slope / rotor])))
    longest = min(_LONGEST_STEP, _SHARE / rate) if rate > 0.0 else _LONGEST_STEP
    return max(1, math.ceil(period / longest - _ROUNDING))


def compute_rest(
    robot: PlantRobot, load: FloatArray, names: tuple[str, ...], elements: Elements | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return torsions (n,) at which the springs carry `load` (n,) in N m or N, reached from zero.

    Beside them plays P_i (n, m) in rad or m, or states of elements. The first root is bracketed by trials
    that grow by a tenth, then halved to the last digit.
    """
    springs = Springs(robot)

    def compute_torque(joint: int, phi: float) -> float:
        if elements is not None:
            return elements.load(joint, phi).output
        play = _compute_virgin_play(robot, np.full(robot.size, phi))
        return float(springs.compute_torque(phi, play, joint))

    first = np.abs(load) / (robot.stiffness + robot.weight.sum(axis=1))
    phi = np.array(
        [
            _locate_torsion(partial(compute_torque, joint), weight, scale)
            for joint, (weight, scale) in enumerate(zip(load.tolist(), first.tolist(), strict=True))
        ]
    )
    lost = [name for name, angle in zip(names, phi.tolist(), strict=True) if not np.isfinite(angle)]
    if lost:
        text = f"the springs of {', '.join(lost)} cannot carry the weight of the robot; make them stiffer"
        raise SolverError(Notice(code="simulate.weak-spring", text=text))
    if elements is None:
        return phi, _compute_virgin_play(robot, phi)
    states = [elements.load(joint, torsion).states for joint, torsion in enumerate(phi.tolist())]
    return phi, elements.pad(states)


def _compute_virgin_play(robot: PlantRobot, phi: FloatArray) -> FloatArray:
    return np.asarray(np.sign(phi)[:, None] * np.maximum(np.abs(phi)[:, None] - robot.radius, 0.0))


def _locate_torsion(compute_torque: Callable[[float], float], load: float, scale: float) -> float:
    """Return the torsion at which a spring carries a load, about `scale`; NaN where there is none."""
    idle = compute_torque(0.0)
    side = 1.0 if load > idle else -1.0

    def compute_excess(phi: float) -> float:
        return side * (compute_torque(phi) - load)

    if load == idle:
        return 0.0
    high = scale or _LEAST_TORSION
    for _ in range(_MOST_TRIALS):
        if compute_excess(side * high) >= 0.0:
            break
        high *= _GROWTH
    else:
        return float("nan")
    low = 0.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if compute_excess(side * middle) >= 0.0 else (middle, high)
    return side * high
