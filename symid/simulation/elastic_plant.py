"""The plant of an elastic robot: its values, its rest under its weight, its motion, in C or in NumPy.

Robot and its library's card -> ElasticValues -> PlantRobot. Library, PlantRobot, PlantExperiment -> PlantLog:
compiled where there is a compiler, else by the same equations and steps as `templates/c/plant.c` in NumPy,
several hundred times slower. Robots whose friction has a state are computed in NumPy alone, with the bristles
of `rigid_plant`.

    rest: S(v(phi)) = g,   v on the virgin curve: P_i = sign(phi) max(|phi| - r_i, 0)

Supported: robots all of whose coordinates belong to elastic joints, rotors included; steps short enough for
the fastest motion; springs loaded once from zero.
Not supported: robots that are elastic in part; joints without rotor inertia; dry friction that jumps.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import final

import numpy as np

from symid.arrays import FloatArray, FrozenArrays
from symid.codegen import (
    Library,
    ModelCard,
    PlantExperiment,
    PlantLog,
    PlantRobot,
    has_addresses,
    load_plant_code,
)
from symid.errors import GenerationError, Notice, SolverError, UsageError
from symid.joint_models import REFERENCE_TEMPERATURE, Elasticity, get_friction_law
from symid.robot import (
    Robot,
)
from symid.simulation.experiment import quantise
from symid.simulation.rigid_plant import Bristles, BristleStride, RigidPlantState, build_bristles


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
    elasticity: tuple[Elasticity, ...]


def get_elastic_values(robot: Robot, card: ModelCard) -> ElasticValues:
    """Return the values that the robot file states, or raise a UsageError with all reasons why not."""
    if not card.elastic:
        names = [joint.name for joint, elastic in zip(robot.axes, robot.elastic, strict=True) if not elastic]
        text = (
            f"robot {robot.name!r} is elastic in part: {', '.join(names)} have no [joint.elasticity]; give "
            "one to all joints or to none"
        )
        raise UsageError(Notice(code="usage.not-elastic", text=text))
    notices = tuple(_describe_gaps(robot, card))
    if notices:
        raise UsageError(*notices)
    rotors = {rotor.joint: rotor for rotor in card.rotors}
    beta, rotor, friction = (
        np.array([parameter.value for parameter in parameters], dtype=np.float64)
        for parameters in (card.beta, [rotors[joint.name] for joint in robot.axes], card.friction)
    )
    springs = tuple(spring for spring in card.elasticity if spring is not None)
    return ElasticValues(beta=beta, rotor=rotor, friction=friction, elasticity=springs)


def _describe_gaps(robot: Robot, card: ModelCard) -> Iterator[Notice]:
    """Yield notices on values that are missing or not positive, and on dry friction that jumps."""
    unknown = [entry.name for entry in (*card.beta, *card.rotors, *card.friction) if entry.value is None]
    rotors = {rotor.joint: rotor.value for rotor in card.rotors}
    light = [name for name, value in rotors.items() if value is not None and not value > 0.0]
    soft = []
    for joint, spring in zip(robot.axes, card.elasticity, strict=True):
        if joint.name not in rotors:
            unknown.append(f"rotor_inertia of {joint.name!r}")
        if spring is not None and spring.initial_stiffness is None:
            unknown.append(f"stiffness of {joint.name!r} and of its stops")
        if spring is not None and spring.stiffness is not None and spring.stiffness <= 0:
            soft.append(joint.name)
    if unknown:
        text = (
            f"robot {robot.name!r} cannot be simulated: its file states no value for {', '.join(unknown)}; "
            "give mass, centre of mass and inertia of every link, rotor inertia, friction and elasticity "
            "of every joint"
        )
        yield Notice(code="usage.unknown-values", text=text)
    for names, what in ((light, "rotor_inertia"), (soft, "stiffness")):
        if names:
            text = (
                f"robot {robot.name!r} cannot be simulated: the {what} of {', '.join(names)} must be positive"
            )
            yield Notice(code="usage.not-positive", text=text)
    laws = {joint.name: get_friction_law(joint.friction) for joint in robot.axes}
    bent = [name for name, law in laws.items() if law is not None and law.memory]
    # A motor that sticks is not among the plant's modes.
    smooth = {joint.name for joint in robot.joints if joint.friction.smoothing > 0.0}
    smooth |= {coupling.name for coupling in robot.couplings if coupling.friction.smoothing > 0.0}
    dry = [entry for entry in card.friction if entry.name.startswith("Fc") and entry.value]
    sharp = [entry.name for entry in dry if entry.joint not in (*smooth, *bent)]
    if sharp:
        text = (
            f"robot {robot.name!r}: the dry friction {', '.join(sharp)} jumps at standstill, which elastic "
            "simulation does not support; give [joint.friction] a `smoothing` speed, such as 0.01 rad/s"
        )
        yield Notice(code="usage.sharp-friction", text=text)


def build_plant_robot(values: ElasticValues) -> PlantRobot:
    """Return the numbers as tables; stops and knees that a joint lacks have a weight and slope of zero."""
    springs = values.elasticity
    stops = max(len(spring.stops) for spring in springs)
    knees = max(len(spring.knees) for spring in springs)
    shape = (len(springs), stops)
    radius, weight = np.ones(shape), np.zeros(shape)
    knee, slope = np.ones((len(springs), knees)), np.zeros((len(springs), knees))
    for row, spring in enumerate(springs):
        for column, stop in enumerate(spring.stops):
            radius[row, column], weight[row, column] = stop.threshold, stop.stiffness or 0.0
        for column, bend in enumerate(spring.knees):
            knee[row, column], slope[row, column] = bend.threshold, bend.slope
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


_ROOT_STEPS = 80
_LEAST_SHARE = 1e-9
_LOGGED = ("q", "dq", "theta", "dtheta", "spring", "torque", "work", "friction", "elastic", "damped")


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

    def compute_inner(self, joint: int, phi: float, play: FloatArray) -> float:
        """Return v, in N m or N, of one joint at torsion `phi` with the plays (n, m) where they are."""
        v = (self._stiffness[joint] + self._cubic[joint] * phi * phi) * phi
        for k, radius, weight in self._stops[joint]:
            v += weight * min(max(phi - float(play[joint, k]), -radius), radius)
        return float(v)

    def compute_torque(self, joint: int, phi: float, play: FloatArray) -> float:
        """Return S(v), in N m or N."""
        torque = v = self.compute_inner(joint, phi, play)
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
            kink = self.locate_kink(joint, start, end, play)
            middle = self.compute_torque(joint, 0.5 * (start + kink), play)
            sides = self.compute_torque(joint, start, play) + self.compute_torque(joint, kink, play)
            total += (kink - start) / 6.0 * (sides + 4.0 * middle)
            start = kink
        return total

    def locate_kink(self, joint: int, start: float, end: float, play: FloatArray) -> float:
        """Return the first torsion from `start` towards `end` at which the slope changes; `end` for none."""
        least, way = _LEAST_SHARE * abs(end - start), 1.0 if end > start else -1.0

        def is_between(kink: float) -> bool:
            return way * (kink - start) > least and way * (end - kink) > least

        for k, radius, _ in self._stops[joint]:
            kink = float(play[joint, k]) + way * radius
            end = kink if is_between(kink) else end
        for level, _ in self._knees[joint]:
            apart = self.compute_inner(joint, start, play) - level
            beyond = self.compute_inner(joint, end, play) - level
            if apart * beyond < 0.0:
                kink = self._locate_level(joint, (start, end), play, level)
                end = kink if is_between(kink) else end
        return end

    def _locate_level(
        self, joint: int, interval: tuple[float, float], play: FloatArray, level: float
    ) -> float:
        """Return where in the interval, without a kink of the stops, v crosses `level`."""
        start, end = interval
        apart = self.compute_inner(joint, start, play) - level
        if not self._cubic[joint]:
            return start + (end - start) * apart / (apart - (self.compute_inner(joint, end, play) - level))
        low, high = 0.0, 1.0
        for _ in range(_ROOT_STEPS):
            share = 0.5 * (low + high)
            value = self.compute_inner(joint, start + share * (end - start), play) - level
            low, high = (share, high) if value * apart > 0.0 else (low, share)
        return start + high * (end - start)


@final
class _ElasticStepper:
    """Runge-Kutta steps; a state is a row each for q, dq, theta, dtheta, lost in friction, damped: (6, n)."""

    def __init__(self, library: Library, robot: PlantRobot) -> None:
        self.springs = Springs(robot)
        self._robot = robot
        self._forward: Callable[..., tuple[FloatArray, ...]] = library.bind("forward_dynamics")
        self._friction = library.bind("friction") if robot.friction.size else None
        self._card, self._warm = library.card, np.full(robot.size, REFERENCE_TEMPERATURE)
        self._bristles = build_bristles(library, robot.friction)
        # Before and after a step.
        self.z = self.bent = np.zeros(0 if self._bristles is None else len(self._bristles.owner))

    def compute_springs(self, x: FloatArray, play: FloatArray) -> FloatArray:
        phi = x[2] - x[0]
        pull = [self.springs.compute_torque(joint, float(angle), play) for joint, angle in enumerate(phi)]
        torque: FloatArray = np.array(pull) + self._robot.damping * (x[3] - x[1])
        return torque

    def _compute_slope(
        self, x: FloatArray, play: FloatArray, torque: FloatArray, z: FloatArray
    ) -> FloatArray:
        robot, twist = self._robot, x[3] - x[1]
        drag, push = np.zeros(robot.size), self.compute_springs(x, play)
        if self._friction is not None:
            given = self._card.gather_friction_inputs(x[3], q=x[2], load=push, temperature=self._warm)
            (drag,) = self._friction(*given, robot.friction)
        if self._bristles is not None:
            drag = np.where(self._bristles.joints, self._bristles.compute_torque(x[3], z), drag)
        (acceleration,) = self._forward(x[0], x[1], push, robot.beta)
        spin = (torque - push - drag) / robot.rotor
        return np.array([x[1], acceleration, x[3], spin, drag * x[3], robot.damping * twist * twist])

    def step(self, x: FloatArray, play: FloatArray, torque: FloatArray, h: float) -> FloatArray:
        bend, z = self._begin(x, play, torque, h), self.z

        def find_slope(y: FloatArray) -> FloatArray:
            bent = z if bend is None else bend.move(y[2] - x[2], y[3])
            return self._compute_slope(y, play, torque, bent)

        k1 = self._compute_slope(x, play, torque, z)
        k2 = find_slope(x + 0.5 * h * k1)
        k3 = find_slope(x + 0.5 * h * k2)
        k4 = find_slope(x + h * k3)
        after: FloatArray = x + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
        if bend is not None:
            self.bent = bend.move(after[2] - x[2], after[3])
        return after

    def _begin(self, x: FloatArray, play: FloatArray, torque: FloatArray, h: float) -> BristleStride | None:
        """Return the step of the bristles; a motor at rest goes where it is pushed."""
        if self._bristles is None:
            return None
        push = self._compute_slope(x, play, torque, self.z)[3]
        modes = np.where(np.where(x[3] == 0.0, push, x[3]) < 0.0, -1, 1)
        state = RigidPlantState(q=x[2], dq=x[3], modes=tuple(modes.tolist()), bristles=self.z)
        return BristleStride(self._bristles, state, h)

    def bends(self, x: FloatArray, after: FloatArray, play: FloatArray) -> bool:
        if self._bristles is not None and bool(np.any((x[3] * after[3] < 0.0) & self._bristles.joints)):
            return True
        rates = (x[3] - x[1]) * (after[3] - after[1])
        if self._robot.radius.shape[1] and bool(np.any(rates < 0.0)):
            return True
        pairs = zip((x[2] - x[0]).tolist(), (after[2] - after[0]).tolist(), strict=True)
        return any(
            self.springs.locate_kink(joint, start, end, play) != end
            for joint, (start, end) in enumerate(pairs)
        )


def simulate_in_numpy(library: Library, robot: PlantRobot, order: PlantExperiment) -> PlantLog:
    """Return the motion of the robot, equal to that of the compiled plant up to rounding."""
    stepper, size = _ElasticStepper(library, robot), robot.size
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
        stepper.z = stepper.bent
        return after

    for tick in range(order.ticks):
        if not np.all(np.isfinite(x[:4])):
            return PlantLog(**log, ticks=tick)
        measured = quantise(x[2], order.step)
        demand = order.stiffness * (order.angle[tick] - measured) + order.damping * (order.speed[tick] - x[3])
        torque: FloatArray = np.clip(demand + order.torque[tick], -order.limit, order.limit)
        row = (x[0], x[1], x[2], x[3], stepper.compute_springs(x, play), torque, work, x[4], elastic, x[5])
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


_SHARE = 0.5
"""Of the time constant of the fastest motion; Runge-Kutta steps are stable up to 2.7 times it."""
_SMALL = 1e-9
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlantRun:
    """The motion, and how it was computed."""

    log: PlantLog
    backend: str
    notices: tuple[Notice, ...] = ()


def simulate_plant(
    library: Library, robot: PlantRobot, order: PlantExperiment, *, compiler: str | None = None
) -> PlantRun:
    """Return the motion; a notice says where it was computed without a compiler (None: the first found)."""
    reason = "there is no C compiler"
    bends = any(spec.name == "friction_step" for spec in library.card.functions)
    try:
        plant = load_plant_code(compiler=compiler) if has_addresses(library) and not bends else None
    except GenerationError as error:
        plant, reason = None, str(error)
    if plant is not None:
        return PlantRun(log=plant.run(library, robot, order), backend="c", notices=plant.notices)
    if not has_addresses(library):
        reason = "the robot's functions are not compiled"
    elif bends:
        reason = "friction has a state"
    text = f"{reason}: the elastic robot is simulated in NumPy, with the same numbers but many times slower"
    notice = Notice(code="simulate.slow-plant", text=text)
    return PlantRun(log=simulate_in_numpy(library, robot, order), backend="python", notices=(notice,))


def _find_bristle_rate(bristles: Bristles, rotor: FloatArray) -> float:
    """Return the largest rate, 1/s, at which motors of inertia `rotor` (n,) swing or settle on bristles."""
    stiffness = np.bincount(bristles.owner, bristles.stiffness, minlength=len(rotor))
    slow, straight = np.full(len(rotor), _SMALL), np.zeros(len(bristles.owner))
    offset = bristles.compute_torque(np.zeros(len(rotor)), straight)
    damping = (bristles.compute_torque(slow, straight) - offset) / _SMALL
    return float(max(np.sqrt(stiffness / rotor).max(), np.max(damping / rotor)))


def count_substeps(
    library: Library, values: ElasticValues, poses: FloatArray, *, period: float, step: float
) -> int:
    """Return the Runge-Kutta steps in a tick of `period` s, each of at most `step` s.

    Fast springs, friction and damping at the poses (K, n), rad or m, shorten the steps.
    """
    # Links and rotors swing against each other, or settle by damping.
    (mass,) = library.evaluate("mass_matrix", poses, values.beta)
    mobility = np.linalg.inv(mass) + np.diag(1.0 / values.rotor)
    root = np.sqrt([_compute_largest_stiffness(spring) for spring in values.elasticity])
    rate = float(np.sqrt(np.linalg.eigvalsh(root[:, None] * mobility * root).max()))
    root = np.sqrt([spring.damping for spring in values.elasticity])
    rate = max(rate, float(np.linalg.eigvalsh(root[:, None] * mobility * root).max()))
    if values.friction.size:
        # Friction stops a rotor.
        speeds = _SMALL * np.vstack([np.eye(len(values.rotor)), -np.eye(len(values.rotor))])
        zero = np.zeros_like(speeds)
        given = library.card.gather_friction_inputs(
            speeds, q=zero, load=zero, temperature=zero + REFERENCE_TEMPERATURE
        )
        (drag,) = library.evaluate("friction", *given, values.friction)
        bristles = build_bristles(library, values.friction)
        if bristles is not None:
            drag = drag * ~bristles.joints
            rate = max(rate, _find_bristle_rate(bristles, values.rotor))
        ahead, back = np.split(np.asarray(drag), 2)
        slope = np.diagonal(ahead - back) / (2.0 * _SMALL)
        rate = max(rate, float(np.max(slope / values.rotor)))
    longest = min(step, _SHARE / rate) if rate > 0.0 else step
    return max(1, math.ceil(period / longest - _ROUNDING))


def _compute_largest_stiffness(spring: Elasticity) -> float:
    """Return the largest slope of a spring whose cubic term is small at the torsions of use."""
    sides = [sum(knee.slope for knee in spring.knees if knee.threshold * side > 0.0) for side in (1.0, -1.0)]
    return (spring.initial_stiffness or 0.0) * (1.0 + max(0.0, *sides))


_GROWTH = 1.1
_MOST_TRIALS = 400
_BISECTIONS = 200


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RestState(FrozenArrays):
    """Springs under load: torsion `phi` (n,) rad or m, `play` P_i (n, m) rad or m."""

    phi: FloatArray
    play: FloatArray


def compute_rest(robot: PlantRobot, load: FloatArray, names: tuple[str, ...]) -> RestState:
    """Return torsions at which the springs carry `load` (n,) in N m or N, reached from zero.

    The first root is bracketed by trials that grow by a tenth, then halved to the last digit.
    """
    springs = Springs(robot)
    phi = np.array(
        [_locate_torsion(springs, robot, joint, float(load[joint])) for joint in range(robot.size)]
    )
    lost = [name for name, angle in zip(names, phi.tolist(), strict=True) if not np.isfinite(angle)]
    if lost:
        text = f"the springs of {', '.join(lost)} cannot carry the weight of the robot; make them stiffer"
        raise SolverError(Notice(code="simulate.weak-spring", text=text))
    return RestState(phi=phi, play=_compute_virgin_play(robot, phi))


def _compute_virgin_play(robot: PlantRobot, phi: FloatArray) -> FloatArray:
    play: FloatArray = np.sign(phi)[:, None] * np.maximum(np.abs(phi)[:, None] - robot.radius, 0.0)
    return play


def _locate_torsion(springs: Springs, robot: PlantRobot, joint: int, load: float) -> float:
    """Return the torsion of one joint, not a number where there is none."""
    side = 1.0 if load > 0.0 else -1.0

    def compute_excess(phi: float) -> float:
        play = _compute_virgin_play(robot, np.full(robot.size, phi))
        return side * springs.compute_torque(joint, phi, play) - abs(load)

    if not load:
        return 0.0
    high = abs(load) / float(robot.stiffness[joint] + robot.weight[joint].sum())
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
