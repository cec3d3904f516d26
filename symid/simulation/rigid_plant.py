"""A rigid robot with dry friction, moved by torques that hold between control ticks.

Library with values, state, a torque held for some time -> the next state.

    M(q) ddq + c(q, dq) + tau_f = tau,   tau_f by mode: +1, -1 (sliding), 0 (held)
    dq > 0: tau_f = viscous_p dq + level_p;  dq < 0: tau_f = viscous_n dq + level_n
    dq = 0: any tau_f within [level_n, level_p] that holds the joint
    curved: tau_f(dq) itself; level_p, level_n are its limits at standstill, viscous is zero
    varying: tau_f = A(dq, q) + B(dq, q) |load|, load = tau - tau_f, so that with r = tau - A
             load = r / (1 + B sgn(r)); at standstill the load is what holds the joint

Classical Runge-Kutta steps with fixed modes, cut where a sliding velocity crosses zero; there the modes are
chosen anew. While a step locates that instant, a curve is continued beyond standstill by its mirror image
about (0, level), so that the step is smooth. A curved law that is continuous at standstill has an empty
band: such a joint creeps and never sticks. Where friction is curved, steps are shortened until the velocity
agrees with that of the third-order formula of the same stages, dq + h/6 (a1 + 2 a2 + 2 a3 + a5), a5 at the
end of the step. Friction must oppose motion, up to a constant torque: its least value ahead is not below
its largest back.

Bristles are part of the state, and such a joint has no held mode; its mode is the direction of motion:

    dz/dt = L z + N(z, dq),   L = -|dq| / |z_e| at the beginning of the step, z_e(dq): z after a long way
    z_k = clamp(z_k + way, -+ z_e)                                  elements, exact for a way without turning

The first has the stages of Cox and Matthews (J. Comput. Phys. 176 (2002) 430-455, ETDRK4), which are those
of Runge and Kutta for L = 0 and stable for any; steps are shortened for z as for the velocity. What bristles
store, sum of stiffness z^2 / 2, is no loss.

Supported: several joints held at once; all static friction laws of joints and couplings, those of the
temperature at its reference; laws with a state.
Not supported: elastic joints, contact, position limits, friction of a drive that turns with
several coordinates; a held joint breaks away at the beginning of a step only (it does no work).
"""

import contextlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from typing import final

import numpy as np
import scipy
from numpy.typing import NDArray

from symid import codegen, joint_models
from symid.arrays import FloatArray, FrozenArrays, freeze
from symid.codegen import JointCard, Library, ModelCard, RigidExperiment, RigidLog
from symid.errors import GenerationError, Notice, SolverError, UsageError
from symid.notation import join_name

_SPEEDS = (1.0, 2.0, -1.0, -2.0)
_STANDSTILL = 1e-300
"""A speed at which every law, powers of the speed included, has its limit at standstill."""
_PROBES = (_STANDSTILL, 1e-4, 1e-2, 1.0, 2.0)
_FASTEST, _SLOWEST, _SPEED_COUNT = 1e6, 1e-9, 1501
"""Grid of speeds for curves: a hundred a decade, fewer for a slower joint."""
_POSITIONS, _LOADS = 8, (0.0, 1e6)
"""At how many positions, and at which loads in N m or N, friction that depends on them is checked."""
_ROUNDING = 1e-12
"""Torques below this share of the largest count as zero."""
_MOST_EVENTS = 200
_MOST_TURNS = 400
"""Exchanges of held and sliding joints; a positive definite M takes a few."""
_ROOT_TOLERANCE, _LEAST_SHARE, _SLACK = 1e-13, 1e-9, 1e-9
_MOST_STRIDES = 500
"""Tries of a step within one substep; enough for friction that stops a joint at 1e6 / s within 1 ms."""
_COMPILED_STRIDES = 20_000
"""The same of the compiled plant, as rigid_plant.c has it: implicit steps."""
_STRIDE_ERROR = 1e-7
"""Allowed relative error of the velocity in a step of the third-order formula."""
_STRIDE_FLOOR = 1e-10
"""Allowed absolute error of that velocity, rad/s or m/s."""
_LONG_WAY = 1e9
"""Rad or m, after which all bristles slip."""
Modes = tuple[int, ...]
FrictionCurve = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrictionLines(FrozenArrays):
    """The lines of all coordinates; rows: [standstill, positive, negative], so that mode -1 is the last.

    Args:
        viscous: (3, n) N m s/rad or N s/m. level: (3, n) N m or N; the first row of both is zero.
        curved: (n,) which coordinates have a curve.
        varying: (n,) which depend on position or load; they are curved, and their level is zero here.
        curve: friction at velocities, positions and loads, all (n,) or all (N, n); None where no coordinate
            is curved.
    """

    viscous: FloatArray
    level: FloatArray
    curved: NDArray[np.bool_]
    varying: NDArray[np.bool_]
    curve: FrictionCurve | None = None

    def compute_drag(
        self, modes: Sequence[int], dq: FloatArray, q: FloatArray, torque: FloatArray
    ) -> FloatArray:
        """Return what sliding adds to the level of each mode, (n,) N m or N; zero at standstill."""
        rows, columns = np.array(modes), np.arange(len(modes))
        drag: FloatArray = self.viscous[rows, columns] * dq
        if self.curve is None:
            return drag
        level, speeds = self.level[rows, columns], rows * np.abs(dq)
        if not self.varying.any():
            ahead, base = self.curve(speeds, level, level), level
        else:
            # Where torques less friction are the loads.
            at = np.array([rows * _STANDSTILL, np.where(dq == 0.0, rows * _STANDSTILL, speeds)])
            given, zero = np.broadcast_to(q, at.shape), np.zeros(at.shape)
            free = self.curve(at, given, zero)
            share, rest = self.curve(at, given, zero + 1.0) - free, torque - free
            start, ahead = torque - rest / (1.0 + share * np.sign(rest))
            base = np.where(self.varying, start, level)
        side = np.where(rows * dq >= 0.0, 1.0, -1.0)
        moving = self.curved & (rows != 0) & (dq != 0.0)
        drag = np.where(moving, side * (ahead - base), drag)
        return np.where(self.varying & (rows != 0), base + drag, drag)

    def compute_band(self, q: FloatArray, load: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the largest and the least friction (n,) of joints held at `q` (n,) under loads (n,)."""
        _, upper, lower = self.level
        if self.curve is None or not self.varying.any():
            return upper, lower
        above, below = (self.curve(np.full(len(q), side * _STANDSTILL), q, load) for side in (1.0, -1.0))
        return np.where(self.varying, above, upper), np.where(self.varying, below, lower)


def get_parameter_values(parameters: tuple[codegen.ParameterCard, ...], robot: str) -> FloatArray:
    """Return the values of parameters, (p,), or raise a UsageError if the robot file does not state them."""
    unknown = [parameter.name for parameter in parameters if parameter.value is None]
    if unknown:
        text = f"robot {robot!r} cannot be simulated: its file states no value for {', '.join(unknown)}; "
        text += "give mass, centre of mass, inertia and friction of every link"
        raise UsageError(Notice(code="usage.unknown-values", text=text))
    return np.array([parameter.value for parameter in parameters], dtype=np.float64)


def gather_inputs(
    card: ModelCard, dq: FloatArray, q: FloatArray | None = None, load: FloatArray | None = None
) -> tuple[FloatArray, ...]:
    """Return the inputs of friction functions at dq (..., n), warm; None: at position zero, without load."""
    zero = np.zeros_like(dq)
    q, load = zero if q is None else q, zero if load is None else load
    return card.gather_friction_inputs(
        dq, q=q, load=load, temperature=zero + joint_models.REFERENCE_TEMPERATURE
    )


def _compute_columns(library: Library, values: FloatArray, speeds: Sequence[float]) -> FloatArray:
    """Return torque (n moved, speeds, n felt, p) of each parameter, one coordinate moved at a time."""
    size = library.card.size
    dq = np.einsum("k,ij->ikj", np.array(speeds), np.eye(size)).reshape(-1, size)
    (columns,) = library.evaluate("friction_regressor", *gather_inputs(library.card, dq))
    return columns.reshape(size, len(speeds), size, -1) * values


def _refuse_shared(card: ModelCard, columns: FloatArray, rest: FloatArray, start: FloatArray | None) -> None:
    """Refuse friction that depends on the speed of another joint; `start`: that at standstill's limits."""
    others = ~np.eye(len(columns), dtype=bool)
    if start is None:
        least = _ROUNDING * np.abs(columns).max()
        once, twice, once_back, twice_back = columns.swapaxes(0, 1)
        ahead, back = twice - once, once_back - twice_back
        linear, bend = 0.5 * (ahead + back), 0.5 * (ahead - back)
        steps = (bend, 2.0 * once - twice - rest, 2.0 * once_back - twice_back - rest)
        uncancelled = np.abs(linear.sum(axis=2)) * others > least
        felt = np.concatenate([linear[uncancelled], *(part[others] for part in steps)])
        shared = np.any(np.abs(felt) > least, axis=0)
    else:
        shared = np.any(np.any(start != rest, axis=1)[others], axis=0)
    names = [parameter.name for parameter, found in zip(card.friction, shared, strict=True) if found]
    if names:
        text = f"robot {card.robot!r} has a drive that turns with several joints: its friction "
        text += f"({', '.join(names)}) makes one joint depend on the speed of another, and such joints "
        text += "cannot stick in simulation; leave that friction out of the robot file"
        raise UsageError(Notice(code="usage.shared-friction", text=text))


def build_friction_lines(library: Library, speeds: FloatArray | None = None) -> FrictionLines:
    """Return the friction lines of the library's coordinates, read from its friction regressor.

    Curves must oppose motion up to `speeds` (n,), rad/s or m/s, None for any. A UsageError names friction
    that drives a joint or depends on the speed of another one, and missing values.
    """
    card = library.card
    viscous, level = np.zeros((3, card.size)), np.zeros((3, card.size))
    curved = varying = np.zeros(card.size, dtype=bool)
    if not card.friction:
        return FrictionLines(viscous=viscous, level=level, curved=curved, varying=varying)
    values = get_parameter_values(card.friction, card.robot)
    columns = _compute_columns(library, values, (*_SPEEDS, 0.0))
    columns, rest = columns[:, :-1], columns[0, -1]
    _refuse_shared(card, columns, rest, None)
    own = np.arange(card.size)
    at = columns[own, :, own]
    # Parameter by parameter: one and two times a column are exact, sums of parameters need not be.
    for row, near, far, step in ((1, 0, 1, 1.0), (2, 2, 3, -1.0)):
        viscous[row] = step * (at[:, far] - at[:, near]).sum(axis=1)
        level[row] = (2.0 * at[:, near] - at[:, far]).sum(axis=1)
    curve: FrictionCurve | None = None
    curved = _list_curved(library)
    if curved.any():
        start = _compute_columns(library, values, (_STANDSTILL, -_STANDSTILL))
        _refuse_shared(card, columns, rest, start)
        varying = np.array([bool(law and {"position", "load"} & set(law.inputs)) for law in _list_laws(card)])
        friction = library.bind("friction")
        viscous[:, curved] = 0.0
        level[1:, curved] = start[own, :, own].sum(axis=2).T[:, curved]

        def compute_curve(dq: FloatArray, q: FloatArray, load: FloatArray) -> FloatArray:
            inputs = (*gather_inputs(card, dq, q, load), values)
            return friction(*inputs)[0].copy() if dq.ndim == 1 else library.evaluate("friction", *inputs)[0]

        curve = compute_curve
    slack = _ROUNDING * max(float(np.abs(part * ~curved).max()) for part in (viscous, level))
    pushes = ~curved & ((level[1] < level[2] - slack) | np.any(viscous < -slack, axis=0))
    if pushes.any():
        what = "friction must oppose motion; its values must not be negative"
        texts = [f"joint {card.joints[joint].name!r}: {what}" for joint in np.flatnonzero(pushes)]
        raise UsageError(*(Notice(code="usage.negative-friction", text=text) for text in texts))
    level[:, varying] = 0.0
    lines = FrictionLines(viscous=viscous, level=level, curved=curved, varying=varying, curve=curve)
    fastest = np.full((1, card.size), np.inf) if speeds is None else speeds[None]
    check_friction_at_speeds(lines, card.joints, np.concatenate([fastest, -fastest]))
    return lines


def build_curved_friction(library: Library, speeds: FloatArray) -> FrictionLines | None:
    """Return the friction lines of motors, None where no friction is curved; see `build_friction_lines`."""
    known = library.card.friction and _list_curved(library).any()
    return build_friction_lines(library, speeds) if known else None


def check_friction_at_speeds(lines: FrictionLines, joints: Sequence[JointCard], dq: FloatArray) -> None:
    """Refuse curves that drive a joint at speeds up to those in dq (N, n), rad/s or m/s."""
    if lines.curve is None:
        return
    size, notices = lines.curved.size, []
    for number in np.flatnonzero(lines.curved).tolist():
        back, ahead = (max(float((side * dq[:, number]).max()), 0.0) for side in (-1.0, 1.0))
        varies = bool(lines.varying[number])
        angles = np.arange(_POSITIONS if varies else 1) / (0.5 * (1.0 + math.sqrt(5.0))) % 1.0
        states = np.array([*product(2.0 * math.pi * angles, _LOADS if varies else _LOADS[:1])])
        bands = [lines.compute_band(*(np.full(size, value) for value in state)) for state in states]
        ends = np.array([[upper[number], lower[number]] for upper, lower in bands])
        grid = np.geomspace(_SLOWEST, min(max(back, ahead, _SLOWEST), _FASTEST), _SPEED_COUNT)
        # (2 sides, states, speeds) samples.
        speeds = np.array([1.0, -1.0])[:, None, None] * np.broadcast_to(grid, (len(states), len(grid)))
        moved = speeds.reshape(-1, 1) * (np.arange(size) == number)
        given = np.broadcast_to(states[:, None, :], (2, len(states), len(grid), 2)).reshape(-1, 2)
        position, load = (np.repeat(given[:, k : k + 1], size, axis=1) for k in range(2))
        torque = lines.curve(moved, position, load)[:, number].reshape(speeds.shape)
        # Over speeds, the least torque ahead and the largest one back, standstill first, must not cross.
        least = np.where(grid <= ahead, torque[0], np.inf)
        largest = np.where(grid <= back, torque[1], -np.inf)
        least = np.minimum.accumulate(np.column_stack([ends[:, 0], least]), axis=1)
        largest = np.maximum.accumulate(np.column_stack([ends[:, 1], largest]), axis=1)
        pushes = np.any(least < largest - _ROUNDING * np.maximum(np.abs(least), np.abs(largest)), axis=0)
        # At standstill, only friction that varies is checked here.
        driven = np.append(0.0, grid)[pushes & (varies | (np.arange(len(pushes)) > 0))].tolist()
        if driven:
            joint, start = joints[number], "from standstill on"
            if driven[0] > _SLOWEST:
                start = f"above about {driven[0]:.2g} {joint.position_unit}/s"
            text = f"joint {joint.name!r}: friction must oppose motion, but it drives the joint {start}; "
            text += "correct its values, or state a lower velocity limit"
            notices.append(Notice(code="usage.negative-friction", text=text))
    if notices:
        raise UsageError(*notices)


def _list_laws(card: ModelCard) -> list[joint_models.FrictionLaw | None]:
    """Return the friction law of each coordinate's own."""
    names = [joint.friction for joint in card.joints]
    return [None if name == joint_models.NO_FRICTION else joint_models.get_law(name) for name in names]


def _list_curved(library: Library) -> NDArray[np.bool_]:
    """Return which coordinates (n,) feel friction whose column is curved."""
    card, laws = library.card, _list_laws(library.card)
    varying = np.array([bool(law and law.inputs != ("velocity",)) for law in laws])
    pairs = zip(card.joints, laws, strict=True)
    own = {join_name(name, joint.number) for joint, law in pairs if law for name in law.own}
    # Of a coupled drive the card has no law: the names of curved parameters are its own.
    joints = {joint.name for joint in card.joints}
    names = tuple(
        {name for law in joint_models.FRICTION_LAWS.values() for name in law.own if name not in {"Fv", "Fc"}}
    )
    bent = [
        entry.name in own or (entry.joint not in joints and entry.name.startswith(names))
        for entry in card.friction
    ]
    columns = _compute_columns(library, np.ones(len(bent)), _PROBES)
    # Dry friction with a smooth sign is no straight line either.
    *near, once, twice = columns.swapaxes(0, 1)
    probes = zip(_PROBES, near, strict=False)
    gaps = [np.abs(once + (speed - 1.0) * (twice - once) - part) for speed, part in probes]
    smooth = np.any(gaps > _ROUNDING * np.abs(columns).max(initial=0.0), axis=(0, 1, 2))
    columns = columns * (np.array(bent) | smooth)
    return np.asarray(np.any(columns != 0.0, axis=(0, 1, 3)) | varying)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bristles(FrozenArrays):
    """The deflections z that friction remembers, read from the library's step of them.

    Args:
        owner: (m,) coordinate of each. stiffness: (m,) N m/rad or N/m.
        elements: (m,) whether it is a spring that slips at its level, and not a bristle that bends over.
        joints: (n,) which coordinates have some.
        step: dq (n,), way (n,) and z (m,) -> friction (n,) in N m or N, z (m,) after the way.
    """

    owner: NDArray[np.int64]
    stiffness: FloatArray
    elements: NDArray[np.bool_]
    joints: NDArray[np.bool_]
    step: Callable[[FloatArray, FloatArray, FloatArray], tuple[FloatArray, FloatArray]]

    def compute_torque(self, dq: FloatArray, z: FloatArray) -> FloatArray:
        """Return the friction (n,) of joints with bristles at dq (n,) and z (m,); zero elsewhere."""
        return np.asarray(self.step(dq, np.zeros_like(dq), z)[0] * self.joints)

    def find_ends(self, dq: FloatArray, modes: Sequence[int]) -> FloatArray:
        """Return where z (m,) ends after a long way in the direction of `modes` at dq (n,)."""
        return self.step(dq, _LONG_WAY * np.array(modes, dtype=np.float64), np.zeros(len(self.owner)))[1]

    def compute_energy(self, z: FloatArray) -> FloatArray:
        """Return what z (..., m) stores, (...) J."""
        return np.asarray(0.5 * ((z * z) @ self.stiffness))


def build_bristles(library: Library, friction: FloatArray | None = None) -> Bristles:
    """Return the bristles of a library's joints; `friction` (p,) in place of its own values.

    A UsageError names missing values.
    """
    card, none = library.card, np.zeros(0)
    joints = np.array([bool(law and law.memory) for law in _list_laws(card)])
    if not joints.any():
        return Bristles(
            owner=none.astype(np.int64),
            stiffness=none,
            elements=none.astype(bool),
            joints=joints,
            step=lambda _, way, z: (0.0 * way, z),
        )
    values = get_parameter_values(card.friction, card.robot) if friction is None else friction
    bound = library.bind("friction_step")
    still, ways = np.zeros(card.size), np.ones(card.size)
    given = gather_inputs(card, still)

    def step(dq: FloatArray, way: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        torque, after = bound(dq, way, z, *given[1:], values)
        return torque.copy(), after.copy()

    spec = next(spec for spec in card.functions if spec.name == "friction_step")
    size = next(port.size for port in spec.inputs if port.name == "z")
    # Half of what each bears at standstill is within what it can bear.
    _, ends = step(still, _LONG_WAY * ways, np.zeros(size))
    rest, _ = step(still, still, np.zeros(size))
    felt = np.array([step(still, still, row)[0] - rest for row in np.diag(0.5 * ends)])
    owner = np.argmax(np.abs(felt), axis=1)
    laws = [joint_models.get_law(card.joints[number].friction) for number in owner.tolist()]
    return Bristles(
        owner=owner,
        stiffness=felt[np.arange(size), owner] / (0.5 * ends),
        elements=np.array([law.elements for law in laws]),
        joints=joints,
        step=step,
    )


@final
class BristleStride:
    """Deflections at the stages of a step of h, one after another, from `state`."""

    def __init__(self, bristles: Bristles, state: "RigidPlantState", h: float) -> None:
        self._bristles, self._modes, self._h = bristles, state.modes, h
        self._before = self._middle = state.bristles
        self._side = np.array(state.modes, dtype=np.float64)[bristles.owner]
        self._ends = np.abs(bristles.find_ends(state.dq, state.modes))
        self._rate = -self._side * state.dq[bristles.owner] / self._ends
        # phi_1 = (e^x - 1) / x, phi_2 = (phi_1 - 1) / x and phi_3 = (phi_2 - 1/2) / x.
        x = h * self._rate
        self._share = [scipy.special.hyp1f1(1.0, k + 1.0, x) / math.factorial(k) for k in (1, 2, 3)]
        self._half = 0.5 * h * scipy.special.exprel(0.5 * x)
        self._rests = [self._find_rest(state.bristles, state.dq)]

    def _find_rest(self, z: FloatArray, dq: FloatArray) -> FloatArray:
        """Return N, (m,) rad/s or m/s."""
        speed = dq[self._bristles.owner]
        return np.asarray(speed - (self._side * speed / self._ends + self._rate) * z)

    def move(self, way: FloatArray, dq: FloatArray) -> FloatArray:
        """Return z (m,) at the next stage, after `way` (n,) and at dq (n,)."""
        rests, decay = self._rests, np.exp(0.5 * self._h * self._rate)
        if len(rests) < 3:
            z = decay * self._before + self._half * rests[-1]
            self._middle = z if len(rests) == 1 else self._middle
        elif len(rests) == 3:
            z = decay * self._middle + self._half * (2.0 * rests[2] - rests[0])
        else:
            one, two, three = self._share
            z = decay * decay * self._before + self._h * (
                (one - 3.0 * two + 4.0 * three) * rests[0]
                + 2.0 * (two - 2.0 * three) * (rests[1] + rests[2])
                + (4.0 * three - two) * rests[3]
            )
        self._ends = np.abs(self._bristles.find_ends(dq, self._modes))
        slipped = np.clip(self._before + way[self._bristles.owner], -self._ends, self._ends)
        z = np.where(self._bristles.elements, slipped, z)
        rests.append(self._find_rest(z, dq))
        return z

    def compute_excess(self) -> float:
        """Return the error of z at the end, relative to the one allowed."""
        _, two, three = self._share
        error = np.abs(self._h * (4.0 * three - two) * (self._rests[4] - self._rests[3]))
        return float(np.max(error * ~self._bristles.elements / (_STRIDE_ERROR * self._ends)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigidPlantState:
    """The state of the robot; its arrays are never written to.

    Args:
        q, dq: (n,) rad or m, rad/s or m/s. modes: friction mode of each joint, see the module.
        work: J, done by the torques so far. dissipation: J, lost in friction so far.
        events: how often a joint came to rest or turned so far. bristles: z (m,) rad or m, see the module.
    """

    q: FloatArray
    dq: FloatArray
    modes: Modes
    bristles: FloatArray = field(default_factory=lambda: np.zeros(0))
    work: float = 0.0
    dissipation: float = 0.0
    events: int = 0


def build_rest_state(q: FloatArray, bristles: int = 0) -> RigidPlantState:
    """Return the state at rest at `q` (n,), with as many bristles, all straight."""
    return RigidPlantState(
        q=np.array(q, dtype=np.float64), dq=np.zeros(len(q)), modes=(0,) * len(q), bristles=np.zeros(bristles)
    )


@final
class RigidPlant:
    """The solver in NumPy: robot functions bound once, parameter values, friction lines, bristles.

    `friction` are the lines of steady sliding; those of the joints without bristles move the robot. `code` is
    the compiled solver; where it is None, `notices` say why.
    """

    def __init__(self, library: Library, *, speeds: FloatArray | None = None) -> None:
        """Bind the functions; friction must oppose motion up to `speeds` (n,), rad/s or m/s (UsageError)."""
        card = library.card
        self.size = card.size
        self._joints = card.joints
        self.beta = get_parameter_values(card.beta, card.robot)
        self.values = get_parameter_values(card.friction, card.robot)
        self.friction: FrictionLines = build_friction_lines(library, speeds)
        self.bristles: Bristles = build_bristles(library)
        lines, others = self.friction, ~self.bristles.joints
        self.lines = FrictionLines(
            viscous=lines.viscous * others,
            level=lines.level * others,
            curved=lines.curved & others,
            varying=lines.varying & others,
            curve=lines.curve if np.any(lines.curved & others) else None,
        )
        self._forward: Callable[..., tuple[FloatArray, ...]] = library.bind("forward_dynamics")
        self._mass: Callable[..., tuple[FloatArray, ...]] = library.bind("mass_matrix")
        self._bias: Callable[..., tuple[FloatArray, ...]] = library.bind("bias")
        called = (("friction", len(card.friction)), ("friction_step", self.memory))
        names = [*codegen.RIGID_FUNCTIONS, *(name for name, count in called if count)]
        self.code, self.notices = find_compiled_plant(library, names, "rigid")

    @property
    def is_checked(self) -> bool:
        """Return whether errors shorten the steps in any case: friction is curved or has a state."""
        return self.lines.curve is not None or self.memory > 0

    @property
    def memory(self) -> int:
        """Return how many deflections friction remembers."""
        return len(self.bristles.owner)

    def advance(
        self,
        state: RigidPlantState,
        torque: FloatArray,
        duration: float,
        substeps: int = 1,
        *,
        controlled: bool = False,
    ) -> RigidPlantState:
        """Return the state after `torque` (n,) was held for `duration` in s.

        The error of the velocity shortens all steps if `controlled`, else where friction is curved. A
        SolverError if joints start and stop without end, friction is too steep, or no choice of resting
        joints fits.
        """
        checked = controlled or self.is_checked
        step, events, tries = duration / substeps, state.events, 0
        for _ in range(substeps):
            left = longest = step
            while left > 0.0:
                state = self._settle(state, torque)
                longest = min(left, longest)
                after, taken, longest, tried = self._choose_stride(state, torque, longest, checked=checked)
                tries += tried
                share, modes = 1.0, list(state.modes)
                crossed = np.flatnonzero(after.dq * np.array(modes) < 0.0).tolist()
                if crossed:
                    # To where the first joint stops, and the state there, at rest.
                    stops = [(self._locate_stop(joint, state, torque, taken), joint) for joint in crossed]
                    share, stopping = min(stops)
                    after = self._stride(state, torque, share * taken)[0]
                    dq = after.dq.copy()
                    dq[stopping], modes[stopping] = 0.0, 0
                    after = replace(after, dq=dq, modes=tuple(modes), events=after.events + 1)
                state = after
                left *= 1.0 - share * (taken / left)
                if state.events - events > _MOST_EVENTS:
                    raise SolverError(_describe_failure("chatter", state.q, duration))
                if tries > _MOST_STRIDES * substeps:
                    raise SolverError(self.describe_steep(duration, _MOST_STRIDES))
        return state

    def _choose_stride(
        self, state: RigidPlantState, torque: FloatArray, h: float, *, checked: bool
    ) -> tuple[RigidPlantState, float, float, int]:
        """Return the state after a step of `h` at most, its length, that of the next, how many were tried."""
        if not checked:
            return self._stride(state, torque, h)[0], h, h, 1
        held = [joint for joint, mode in enumerate(state.modes) if mode == 0]
        level = self.lines.level[np.array(state.modes), np.arange(self.size)]
        for tries in range(1, _MOST_STRIDES + 1):
            with np.errstate(over="ignore", invalid="ignore"):
                after, last, bent = self._stride(state, torque, h)
                drag = self._compute_drag(after.modes, after.q, after.dq, torque, after.bristles)
                # The error of the velocities, relative to the one allowed.
                ahead = self._accelerate(after.q, after.dq, torque - level - drag, held)
                error = (h / 6.0) * np.abs(ahead - last)
                excess = float(np.max(error / (_STRIDE_ERROR * np.abs(after.dq) + _STRIDE_FLOOR)))
                excess = max(excess, bent) if math.isfinite(bent) else bent
            # No number, after a step far too long, is no reason to accept it.
            factor = min(4.0, max(0.1, 0.9 * excess**-0.25)) if excess > 0.0 else 4.0
            if excess <= 1.0:
                return after, h, factor * h, tries
            h *= factor if math.isfinite(excess) else 0.1
        return after, h, h, _MOST_STRIDES

    def compute_weight(self, q: FloatArray) -> FloatArray:
        """Return the torque (n,) in N m or N that holds the robot at rest at `q` (n,)."""
        return self._bias(np.asarray(q, dtype=np.float64), np.zeros(self.size), self.beta)[0].copy()

    def _stride(
        self, state: RigidPlantState, torque: FloatArray, h: float
    ) -> tuple[RigidPlantState, FloatArray, float]:
        """Return the state after a step with the modes held, its last stage's ddq (n,), the excess of z."""
        lines, rows = self.lines, (np.array(state.modes), np.arange(self.size))
        level, viscous = lines.level[rows], lines.viscous[rows]
        push = torque - level
        held = [joint for joint, mode in enumerate(state.modes) if mode == 0]

        def slope(q: FloatArray, dq: FloatArray) -> tuple[FloatArray, FloatArray, float]:
            drag = viscous * dq
            if bend is not None or lines.curve is not None:
                # The first stage is where the step begins.
                z = state.bristles if bend is None or dq is state.dq else bend.move(q - state.q, dq)
                drag = self._compute_drag(state.modes, q, dq, torque, z)
            return dq, self._accelerate(q, dq, push - drag, held), float(drag @ dq)

        bend = BristleStride(self.bristles, state, h) if self.memory else None
        q, dq, z = state.q, state.dq, state.bristles
        v1, a1, p1 = slope(q, dq)
        v2, a2, p2 = slope(q + 0.5 * h * v1, dq + 0.5 * h * a1)
        v3, a3, p3 = slope(q + 0.5 * h * v2, dq + 0.5 * h * a2)
        v4, a4, p4 = slope(q + h * v3, dq + h * a3)
        move = (h / 6.0) * (v1 + 2.0 * (v2 + v3) + v4)
        lost = (h / 6.0) * (p1 + 2.0 * (p2 + p3) + p4)
        speed = dq + (h / 6.0) * (a1 + 2.0 * (a2 + a3) + a4)
        if bend is not None:
            z = bend.move(move, speed)
            lost -= float(self.bristles.compute_energy(z) - self.bristles.compute_energy(state.bristles))
        after = RigidPlantState(
            q=q + move,
            dq=speed,
            modes=state.modes,
            bristles=z,
            work=state.work + float(torque @ move),
            dissipation=state.dissipation + lost + float(level @ move),
            events=state.events,
        )
        return after, a4, 0.0 if bend is None else bend.compute_excess()

    def _compute_drag(
        self, modes: Modes, q: FloatArray, dq: FloatArray, torque: FloatArray, z: FloatArray
    ) -> FloatArray:
        """Return friction (n,) beyond the level of each mode, that of bristles whole."""
        drag = self.lines.compute_drag(modes, dq, q, torque)
        return drag + self.bristles.compute_torque(dq, z) if self.memory else drag

    def describe_steep(self, duration: float, steps: int) -> Notice:
        """Return the notice on friction that stops a joint much faster than `duration` in s, in `steps`."""
        lines = self.lines
        creeps = lines.curved & (lines.level[1] <= lines.level[2])
        viscous: NDArray[np.bool_] = np.any(lines.viscous != 0.0, axis=0)
        found = next((kind for kind in (creeps, lines.curved, viscous) if kind.any()), viscous)
        names = [joint.name for joint, steep in zip(self._joints, found, strict=True) if steep]
        text = f"the friction of {' or '.join(map(repr, names))} is too steep around standstill for "
        text += f"{steps} steps within {duration:g} s; widen its transition (dq0, smoothing; lower g2, "
        text += "g3, g5), or use a model that jumps at standstill, such as stribeck; steps of the compiled "
        text += "plant, which needs a C compiler, are implicit and do much more"
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

    def _settle(self, state: RigidPlantState, torque: FloatArray) -> RigidPlantState:
        """Return the state with modes chosen for the joints that are at rest (Murty 1974)."""
        resting = [joint for joint, mode in enumerate(state.modes) if mode == 0]
        if not resting:
            return state
        modes, columns = list(state.modes), np.arange(self.size)
        mass = self._mass(state.q, self.beta)[0].copy()
        net = torque - self._bias(state.q, state.dq, self.beta)[0]
        # Held joints need a torque within their band, others accelerate as they slide: the first violation is
        # exchanged, which ends as M is positive definite.
        for _ in range(_MOST_TURNS):
            rows = np.array(modes)
            drag = self._compute_drag(tuple(modes), state.q, state.dq, torque, state.bristles)
            friction = drag + self.lines.level[rows, columns]
            free = np.flatnonzero(rows)
            acceleration = np.zeros(self.size)
            if free.size:
                acceleration[free] = np.linalg.solve(mass[np.ix_(free, free)], (net - friction)[free])
            need = net - mass @ acceleration
            upper, lower = self.lines.compute_band(state.q, torque - need)
            # Bristles hold with what they are bent: they give way to all else.
            upper, lower = (np.where(self.bristles.joints, drag, end) for end in (upper, lower))
            # A torque this far beyond the band still counts as within it.
            slack = _SLACK * (np.abs(need) + upper - lower)
            pushed = (need > upper + slack).astype(int) - (need < lower - slack)
            better = np.where(rows == 0, pushed, np.where(acceleration * rows < 0.0, 0, rows))
            wrong = [joint for joint in resting if better[joint] != modes[joint]]
            if not wrong:
                break
            modes[wrong[0]] = int(better[wrong[0]])
        else:
            raise SolverError(_describe_failure("not-converged", state.q, 0.0))
        moves = zip(modes, self.bristles.joints.tolist(), strict=True)
        return replace(state, modes=tuple(mode or int(bends) for mode, bends in moves))

    def _locate_stop(self, joint: int, before: RigidPlantState, torque: FloatArray, h: float) -> float:
        """Return the share of the step at which `joint` stops."""
        mode = before.modes[joint]

        def speed(share: float) -> float:
            return float(self._stride(before, torque, share * h)[0].dq[joint]) * mode

        low, high = 0.0, 1.0
        # A joint that has just broken away starts at zero speed: locate where it was sliding.
        if not before.dq[joint] * mode > 0.0:
            low = 0.5
            while not speed(low) > 0.0:
                low, high = 0.5 * low, low
                if low <= _LEAST_SHARE:
                    return high
        return float(scipy.optimize.brentq(speed, low, high, xtol=_ROOT_TOLERANCE))


def _describe_failure(end: str, q: FloatArray, duration: float) -> Notice:
    """Return the notice on a motion that ended as "chatter" or "not-converged" at `q`."""
    pose = ", ".join(f"{value:.3g}" for value in q.tolist())
    if end == "chatter":
        text = f"joints came to rest more than {_MOST_EVENTS} times within {duration:g} s, at q = {pose}; "
        text += "lower the control gains or the friction, or shorten the control period"
    else:
        text = f"at q = {pose} no choice of joints that rest and joints that slide fits the torques: the "
        text += "mass matrix is not positive definite there, or friction grows with the load too much; "
        text += "correct the masses, inertias and friction of the robot"
    return Notice(code=f"simulate.{end}", text=text)


def quantise(values: FloatArray, step: FloatArray) -> FloatArray:
    """Return `values` (..., n) rounded to whole encoder steps (n,); a step of 0 rounds nothing."""
    safe = np.where(step > 0.0, step, 1.0)
    return np.where(step > 0.0, np.round(values / safe) * safe, values)


def find_compiled_plant(
    library: Library,
    names: Sequence[str],
    kind: str,
    *,
    springs: Sequence[joint_models.Elasticity] = (),
    lacking: str = "",
) -> tuple[codegen.CompiledPlant | None, tuple[Notice, ...]]:
    """Return the compiled plant of a `kind` of robot and its notices, or None and one that says why not.

    `names` are functions that it calls, `springs` those in no table, `lacking` what else it lacks, in words.
    """
    reason = lacking or "there is no C compiler"
    if not codegen.has_addresses(library, names):
        reason = "the robot's functions are not compiled"
    elif not lacking:
        try:
            plant = codegen.load_plant_code(tuple(springs), kind)
        except GenerationError as error:
            plant, reason = None, str(error)
        if plant is not None:
            return plant, plant.notices
    text = f"{reason}: the {kind} robot is simulated in NumPy, many times slower; see `symid doctor`"
    return None, (Notice(code="simulate.slow-plant", text=text),)


def simulate_rigid_plant(library: Library, plant: RigidPlant, order: RigidExperiment) -> RigidLog:
    """Return the motion of a controlled robot.

    A robot that fixed steps bring out of control, or to endless stops, is simulated again with steps as long
    as their error allows. A SolverError if joints start and stop without end, friction is too steep, or no
    choice of resting joints fits.
    """
    run = partial(_run_once, library, plant)
    if order.controlled or plant.is_checked:
        return run(order)
    again = replace(order, controlled=True)
    try:
        log = run(order)
    except SolverError:
        with contextlib.suppress(SolverError):
            return run(again)
        raise
    if log.end == "away":
        # What is unstable itself may be too fast for any step.
        with contextlib.suppress(SolverError):
            return run(again)
    return log


def _run_once(library: Library, plant: RigidPlant, order: RigidExperiment) -> RigidLog:
    """Return the motion in steps as `order` has them; errors are those of `simulate_rigid_plant`."""
    if plant.code is None:
        # Equal to the compiled plant within the error of its steps.
        modes = tuple(int(side) for side in np.sign(order.dq))
        state = replace(build_rest_state(order.q, plant.memory), dq=order.dq, modes=modes)
        measured, velocity, end = order.measured, order.velocity, "well"
        states, torques = [], []
        for k, wanted in enumerate(order.position):
            before, measured = measured, quantise(state.q, order.step)
            raw = state.dq if order.sensed else (measured - before) / order.period
            velocity = velocity + order.blend * (raw - velocity)
            pull = order.torque[k] + order.stiffness * (wanted - measured)
            demand = pull + order.damping * (order.speed[k] - velocity)
            torques.append(np.minimum(np.maximum(demand, -order.limit), order.limit))
            states.append(state)
            if not (np.all(np.abs(state.q - wanted) < order.reach) and np.all(np.isfinite(state.dq))):
                end = "away"
                break
            if k + 1 < len(order.position):
                # A loop that runs away overflows within a period, and is refused at its end.
                with np.errstate(over="ignore", invalid="ignore"):
                    state = plant.advance(
                        state, torques[-1], order.period, order.substeps, controlled=order.controlled
                    )
        log = RigidLog(
            q=np.array([state.q for state in states]),
            dq=np.array([state.dq for state in states]),
            torque=np.array(torques),
            z=np.array([state.bristles for state in states]),
            work=np.array([state.work for state in states]),
            lost=np.array([state.dissipation for state in states]),
            end=end,
            events=state.events,
        )
    else:
        lines, bristles = plant.lines, plant.bristles
        friction = (lines.viscous, lines.level, lines.curved, lines.varying)
        deflections = (bristles.joints, bristles.owner, bristles.stiffness, bristles.elements)
        tables = tuple(map(freeze, (*friction, *deflections)))
        log = plant.code.run_rigid(library, (plant.beta, plant.values), tables, order)
    if log.end in {"chatter", "not-converged"}:
        raise SolverError(_describe_failure(log.end, log.q[-1], order.period))
    if log.end == "steep":
        raise SolverError(plant.describe_steep(order.period, _COMPILED_STRIDES))
    return log
