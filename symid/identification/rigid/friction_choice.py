"""The friction law of every joint, chosen on held-out torque inside the identification of the whole robot.

Library with plain friction, recordings, laws -> a law with its shape values for every joint, and all trials.

    tau_j = X_j x + sum_k c_k Phi_k(dq_j, load_j, ..; s) + noise,    x: base parameters, coupled drives

The columns of all laws at all nodes of their shape values stand side by side in one table a joint
(`friction_tables`), as sums of products, stretch by stretch. Whatever is shared with other joints is
eliminated (variable projection, Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973) 413-432), so that a law
at a node is a problem of a few unknowns:

    M = sum_(i != j) w_i S_i + w_j G_j,    K = M_DD - M_Dx M_xx^-1 M_xD,    c = K_cc^-1 K_cy

G are sums of products of a joint, S the same without its own friction. Joints take turns until no law
changes; then nodes are set closer about the best, and laws are made linear there (Gauss and Newton).

Where the load of a joint was measured behind its gear, its law is chosen from the torque of the motor less
the load: X_j x are then torques of rotors, and what the model of the links lacks is in neither.

Supported: every static law; loads measured behind the gears or computed from the estimate, iterated with it;
several recordings; joints that keep a law. Not supported: laws with a state; friction of drives that turn
several joints, which stays as the robot file has it.
"""

import itertools
from collections.abc import Mapping, Sequence, Set as AbstractSet
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.errors import IdentifiabilityError, Notice
from symid.identification.estimators import LawSelection, LawTrial
from symid.identification.regression import Rotor, warn_of_load_gain
from symid.identification.rigid.friction_tables import (
    JointTable,
    Motion,
    Node,
    TangentLaw,
    Wanted,
    bound_shape,
    gather_inputs,
    list_shape_nodes,
    load_joints,
    measure_gain,
    prepare_motion,
    refine_nodes,
    tabulate_laws,
)
from symid.joint_models import NO_FRICTION, FrictionLaw, FrictionValues, compute_columns, get_law
from symid.logs import Recording
from symid.robot import Processing

PLAIN = "coulomb-viscous-offset"
"""What other laws are compared with."""
_CONDITION = 1e-9
"""Least eigenvalue of the scaled products of a law's columns that counts as identifiable."""
_FEWEST = 20
"""Windows of a joint that choose a law."""
_ROUNDS = 6
"""Of all joints in turn, in one pass over the data."""


class _Reduced(NamedTuple):
    """A joint without its own friction: S of training sets, Q of stretches that leave [-x 1] Q [-x 1]'."""

    schur: FloatArray
    left: FloatArray


def _solve(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Return the solution of normal equations (..., n, n), scaled, with a tiny ridge."""
    lengths = np.sqrt(np.maximum(np.diagonal(matrix, axis1=-2, axis2=-1), 1e-300))
    scaled = matrix / lengths[..., :, None] / lengths[..., None, :]
    scaled = scaled + _RIDGE * np.eye(matrix.shape[-1])
    return np.asarray(np.linalg.solve(scaled, right / lengths[..., None]) / lengths[..., None])


_RIDGE = 1e-11


def _list_training(grams: FloatArray) -> FloatArray:
    """Return the sums (S + 1, k, k) over all stretches but one, and last over all."""
    whole = grams.sum(axis=0)
    return np.concatenate([whole - grams, whole[None]])


def _reduce(table: JointTable, places: Sequence[int], weight: float) -> _Reduced:
    """Return a joint without the friction of these columns of its table."""
    p, size = table.shared, table.grams.shape[1]
    own, rest = [p + k for k in places], [*range(p), size - 1]
    sets = weight * _list_training(table.grams[np.ix_(range(len(table.grams)), [*own, *rest], [*own, *rest])])
    c = len(own)
    gains = _solve(sets[:, :c, :c], sets[:, :c, c:]) if c else np.zeros((len(sets), 0, p + 1))
    schur = sets[:, c:, c:] - sets[:, c:, :c] @ gains
    order = [*own, *rest]
    held = weight * table.grams[:, order][:, :, order]
    # [f; x'] of a stretch with f = g_y - g_x x: columns of [-x 1].
    lift = np.concatenate([-gains[:-1], np.tile(np.eye(p + 1), (len(held), 1, 1))], axis=1)
    return _Reduced(schur=schur, left=np.swapaxes(lift, 1, 2) @ held @ lift)


class _Trial(NamedTuple):
    """A law on a joint: best node, linear values, losses (S,) of all joints and its own; weak names."""

    law: FrictionLaw
    node: Node
    linear: FloatArray
    losses: FloatArray
    own: FloatArray
    weak: tuple[str, ...]


_ALIKE = 1e-6
"""Part of a column's squares that must be independent of the rigid columns: a thousandth of its size."""


def _try_laws(table: JointTable, others: _Reduced, weight: float) -> list[_Trial]:
    """Return a trial of every law of a table; `others` is the sum over the other joints."""
    p, size, count = table.shared, table.grams.shape[1], len(table.grams)
    sets = weight * _list_training(table.grams)
    outer = sets[:, :p, :].copy()
    outer[:, :, :p] += others.schur[:, :p, :p]
    outer[:, :, -1] += others.schur[:, :p, -1]
    gains = _solve(outer[:, :, :p], outer[:, :, p:])
    inner = sets[:, p:, p:] - np.swapaxes(outer[:, :, p:], 1, 2) @ gains
    inner[:, -1, -1] += others.schur[:, -1, -1]
    # What the rigid columns are like differs from them by their filter alone.
    before, after = (np.maximum(np.diagonal(part[-1])[:-1], 0.0) for part in (sets[:, p:, p:], inner))
    alike = after <= _ALIKE * before
    found = []
    for _, group in itertools.groupby(table.nodes, key=lambda node: node.law.name):
        nodes = list(group)
        places = np.array([node.places for node in nodes], dtype=np.intp)
        matrix = inner[:, places[:, :, None], places[:, None, :]]
        right = inner[:, places, -1]
        linear = _solve(matrix, right[..., None])[..., 0]
        losses = inner[:, -1, -1][:, None] - np.sum(right * linear, axis=2)
        best = np.argmin(losses, axis=1)
        total, own = np.zeros(count), np.zeros(count)
        for h in range(count):
            chosen, values = list(nodes[best[h]].places), linear[h, best[h]]
            shared = gains[h, :, -1] - gains[h][:, chosen] @ values
            v = np.zeros(size)
            v[:p], v[-1] = -shared, 1.0
            v[[p + k for k in chosen]] = -values
            own[h] = weight * float(v @ table.grams[h] @ v)
            u = np.append(-shared, 1.0)
            total[h] = own[h] + float(u @ others.left[h] @ u)
        k = int(best[-1])
        node, products = nodes[k], matrix[-1, k]
        order: list[int] = []
        if node.places:
            weak = alike[list(node.places)]
            # Linear parameters with a part in a direction that the rows do not determine.
            lengths = np.sqrt(np.maximum(np.diag(products), 1e-300))
            sizes, vectors = np.linalg.eigh(products / lengths / lengths[:, None])
            poor = sizes < _CONDITION * max(float(sizes[-1]), 1e-300)
            lost = np.any(np.abs(vectors[:, poor]) > 1e-3, axis=1)
            order = [*np.flatnonzero(weak), *np.flatnonzero(lost & ~weak)]
        named = tuple(node.law.linear[place].name for place in order)
        found.append(_Trial(node.law, node, linear[-1, k], total, own / weight, named))
    return found


_SURE = 3.0
"""Standard errors by which a law with more unknowns must predict better."""
_EQUAL = 1.0
"""Standard errors up to which laws predict alike."""
_HELPS = 0.01
"""Part of a joint's held-out squares that a law with more unknowns must save."""


def choose_trial(trials: Sequence[_Trial]) -> tuple[int, FloatArray]:
    """Return the place of the trial taken, and how far each is behind the best, in standard errors.

    Of the laws that are identifiable, the plainest is taken that no richer one predicts surely better than;
    of several as plain and as good, the one with fewer shape values, which others may only imitate.
    """
    whole = [k for k, trial in enumerate(trials) if not trial.weak] or [0]
    # What a law costs the other joints counts as well.
    beside = np.min([trial.losses - trial.own for trial in trials], axis=0)
    losses = [trials[k].losses - beside for k in whole]
    best = min(losses, key=np.sum)
    behind = np.full(len(trials), np.inf)
    for k, entry in zip(whole, losses, strict=True):
        # By how many standard errors the losses exceed those of the best; 0 where it hardly matters.
        behind[k] = 0.0
        if entry.sum() > (1.0 + _HELPS) * best.sum():
            logs = np.log(entry / np.maximum(best, 1e-300))
            error = float(np.std(logs, ddof=1)) / np.sqrt(len(logs))
            behind[k] = max(0.0, float(logs.mean())) / error if error > 0.0 else np.inf
    near = [k for k in whole if behind[k] <= _SURE]

    def rank(place: int) -> tuple[int, bool, int, float]:
        law, loss = trials[place].law, float(trials[place].losses.sum())
        shape = law.about if isinstance(law, TangentLaw) else law.shape
        return len(law.linear) + len(law.shape), bool(behind[place] > _EQUAL), len(shape), loss

    return min(near, key=rank), behind


class _State(NamedTuple):
    """Laws so far: a node and a weight of every joint, and how the laws of each were compared."""

    nodes: Sequence[Node]
    weights: FloatArray
    trials: Sequence[Sequence[_Trial]]
    taken: Sequence[int]
    behind: Sequence[FloatArray]


def _weigh(tables: Sequence[JointTable], nodes: Sequence[Node], weights: FloatArray) -> FloatArray:
    """Return weights (n,) from the mean squares that a fit with these laws leaves of every joint."""
    u, found = np.append(-_solve_shared(tables, nodes, weights), 1.0), []
    for table, node in zip(tables, nodes, strict=True):
        left = float(u @ _reduce(table, node.places, 1.0).schur[-1] @ u)
        found.append(left / max(int(table.rows.sum()), 1))
    return 1.0 / np.maximum(found, 1e-300)


def _settle_laws(tables: Sequence[JointTable], start: Sequence[Node]) -> _State:
    """Return the laws after the joints took turns until none changed."""
    nodes, count = list(start), len(tables)
    weights = np.ones(count)
    for _ in range(3):
        weights = _weigh(tables, nodes, weights)
    trials: list[Sequence[_Trial]] = [()] * count
    taken, behind = [0] * count, [np.zeros(0)] * count
    for _ in range(_ROUNDS):
        before = [node.law.name for node in nodes]
        for joint, table in enumerate(tables):
            reduced = _reduce_all(tables, nodes, weights)
            others = _Reduced(np.zeros_like(reduced[joint].schur), np.zeros_like(reduced[joint].left))
            if count > 1:
                rest = [entry for k, entry in enumerate(reduced) if k != joint]
                others = _Reduced(*(np.sum(parts, axis=0) for parts in zip(*rest, strict=True)))
            found = _try_laws(table, others, float(weights[joint]))
            taken[joint], behind[joint] = choose_trial(found)
            trials[joint] = found
            nodes[joint] = found[taken[joint]].node
            weights = _weigh(tables, nodes, weights)
        if before == [node.law.name for node in nodes]:
            break
    return _State(nodes, weights, trials, taken, behind)


def _reduce_all(tables: Sequence[JointTable], nodes: Sequence[Node], weights: FloatArray) -> list[_Reduced]:
    triples = zip(tables, nodes, weights.tolist(), strict=True)
    return [_reduce(table, node.places, weight) for table, node, weight in triples]


def _solve_shared(tables: Sequence[JointTable], nodes: Sequence[Node], weights: FloatArray) -> FloatArray:
    """Return x (p,) of the fit to all rows with these laws."""
    whole = sum(entry.schur[-1] for entry in _reduce_all(tables, nodes, weights))
    p = len(whole) - 1
    return _solve(whole[:p, :p], whole[:p, p:])[:, 0]


_LAWS = (
    *("coulomb-viscous", "asymmetric", "tustin", "stribeck", "lorentzian", "cubic", "power-law"),
    *("load-dependent", "load-dependent-stribeck", "stribeck+cubic", "stribeck-exponent", "makkar"),
    *("position-dependent", "position-torque", "temperature", "temperature-viscous"),
)
_WITH_OFFSET = ("improved-stribeck", "asymmetric-stribeck")
CANDIDATES = (
    *(name for law in _LAWS for name in (law, get_law(f"{law}+offset").name) if name != "asymmetric+offset"),
    *_WITH_OFFSET,
)
"""Laws among which `auto` chooses; waves of the motor's angle are added where a gear is known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JointLaw:
    """The friction of a joint with its values, and how its law was chosen.

    `selection` is None for a joint that hardly moves, or that keeps its law.
    """

    joint: str
    friction: FrictionValues
    selection: LawSelection | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrictionChoice:
    """Laws of all joints with a coordinate, and the base parameters (p,) beside them.

    Args:
        joints: their laws; beta: zero where loads were measured, which needs no model of the links.
        motion: filtered states, with torques of motors less loads where these were measured.
        notices: on loads that were measured.
    """

    joints: tuple[JointLaw, ...]
    beta: FloatArray
    motion: Motion
    notices: tuple[Notice, ...] = ()


Wish = Sequence[str] | FrictionValues
"""Laws that a joint's is chosen from, or the friction that it keeps."""


def choose_laws(
    library: Library,
    recordings: Sequence[Recording],
    processing: Processing,
    *,
    gears: Sequence[float],
    wishes: Sequence[Wish] = (),
    rotors: Sequence[Rotor] = (),
) -> FrictionChoice:
    """Return the laws of all joints of a robot, and their values.

    Args:
        library: functions of the robot with plain friction at its joints.
        recordings: at least one, all of this robot.
        processing: whose cut ends are used.
        gears: (n,) turns of the motors a turn of the joint, 1 where not known.
        wishes: (n,) laws to choose from, or friction whose law and shape values stay; `CANDIDATES` for all
            joints where empty.
        rotors: of coupled drives, which stand beside friction where loads are measured.

    Raises:
        IdentifiabilityError: a law that was named, or is kept, reads what the recordings do not have.
    """
    motion = prepare_motion(library, recordings, processing, rotors=rotors)
    count = library.card.size
    wishes = wishes or (CANDIDATES,) * count
    plain: list[Wanted] = [[(get_law(PLAIN), ())]] * count
    tables = tabulate_laws(motion, plain)
    moving = [int(table.rows.sum()) >= _FEWEST for table in tables]
    nodes = [table.nodes[0] for table in tables]
    weights = _weigh(tables, nodes, np.ones(count))
    motion = load_joints(motion, _solve_shared(tables, nodes, weights))
    inputs = set.intersection(*(set(gather_inputs(one, slice(0, 1), 0)) for one in motion.signals))
    lacking = []
    for card, wish in zip(library.card.joints, wishes, strict=True):
        name, *more = (wish.law,) if isinstance(wish, FrictionValues) else wish
        if not more and name != NO_FRICTION and (missing := set(get_law(name).inputs) - inputs):
            what = " and ".join(sorted(missing))
            text = (
                f"joint {card.name!r}: the friction law {name!r} reads the {what}, which not all logs have: "
                f"name its columns in [log.{min(missing)}], or take another law"
            )
            lacking.append(Notice(code="identify.friction-input", text=text))
    if lacking:
        raise IdentifiabilityError(*lacking)
    speeds = [motion.speeds(joint) if moving[joint] else np.zeros(0) for joint in range(count)]
    calls = zip(wishes, gears, speeds, strict=True)
    wanted = [_list_wanted(wish, gear, inputs, own) for wish, gear, own in calls]
    kept = [isinstance(wish, FrictionValues) for wish in wishes]
    laws = [PLAIN] * count
    for step in range(_PASSES):
        tables = tabulate_laws(motion, wanted)
        # The first node of a law in a table, or of the table where it has no such law.
        begun = [
            next((node for node in table.nodes if node.law.name == law), table.nodes[0])
            for table, law in zip(tables, laws, strict=True)
        ]
        state = _settle_laws(tables, begun)
        motion = load_joints(motion, _solve_shared(tables, state.nodes, state.weights))
        laws = [node.law.name for node in state.nodes]
        chosen = [trials[k] for trials, k in zip(state.trials, state.taken, strict=True)]
        # The last passes are those of the laws that were chosen alone.
        tried = state.trials if step < _COMPARED - 1 else [[trial] for trial in chosen]
        if step == _COMPARED - 1:
            compared, scored = state, tables
        wanted = [
            wanted[joint]
            if kept[joint]
            else [pair for trial in tried[joint] for pair in _approach(trial, speeds[joint], step)]
            for joint in range(count)
        ]
    found = []
    for joint, (card, trial, wish) in enumerate(zip(library.card.joints, chosen, wishes, strict=True)):
        friction = FrictionValues(law=trial.law.name, values=tuple(trial.linear.tolist()))
        if isinstance(wish, FrictionValues):
            friction = replace(wish, values=friction.values)
        elif isinstance(trial.law, TangentLaw):
            moved = _move_tangent(trial.law, trial.linear, speeds[joint])
            friction = FrictionValues(law=moved.name, values=moved.values, shape=moved.about)
        selection: LawSelection | None = None
        if moving[joint] and not kept[joint]:
            selection = _describe_choice(compared, scored[joint], joint, measured=motion.measured[joint])
        found.append(JointLaw(joint=card.name, friction=friction, selection=selection))
    shared = _solve_shared(tables, state.nodes, state.weights)
    return FrictionChoice(
        joints=tuple(found),
        beta=shared[: len(library.card.beta)],
        motion=motion,
        notices=_judge_loads(motion, found, state.nodes),
    )


def _list_wanted(wish: Wish, gear: float, inputs: AbstractSet[str], speeds: FloatArray) -> Wanted:
    """Return the laws to choose from at their first nodes; the plain one for a joint that hardly moves."""
    if isinstance(wish, FrictionValues):
        if wish.law == NO_FRICTION:
            nothing = replace(get_law(PLAIN), name=NO_FRICTION, linear=(), columns=lambda *_: ())
            return [(nothing, ())]
        return [(get_law(wish.law, smoothing=wish.smoothing), wish.shape)]
    if not len(speeds):
        return [(get_law(PLAIN), ())]
    names = list(wish)
    if wish is CANDIDATES and abs(gear) != 1.0:
        # Waves once and twice a turn of joint and motor.
        kinds = (f"position-{kind}-1,2x{abs(gear):.12g}" for kind in ("dependent", "torque"))
        names += [f"{name}{end}" for name in kinds for end in ("", "+offset")]
    laws = [law for law in map(get_law, names) if set(law.inputs) <= inputs]
    return [(law, shape) for law in laws for shape in list_shape_nodes(law, speeds)]


def _judge_loads(motion: Motion, laws: Sequence[JointLaw], nodes: Sequence[Node]) -> tuple[Notice, ...]:
    """Return what was done with measured loads, and warnings where these have another gain."""
    judged = [k for k, law in enumerate(laws) if law.selection is not None and motion.measured[k]]
    if not judged:
        return ()
    names = ", ".join(repr(laws[k].joint) for k in judged)
    text = (
        f"joint{'s'[: len(judged) > 1]} {names}: friction laws were chosen from the torque of the motor less "
        "the measured load, the inertia of rotors fitted along, so that what the model of the links lacks "
        "has no part in them; their values are then fitted with the whole robot"
    )
    found = [Notice(code="identify.measured-load", text=text)]
    for k in judged:
        warnings = warn_of_load_gain(measure_gain(motion, k, nodes[k].law, nodes[k].shape))
        found += [replace(one, text=f"joint {laws[k].joint!r}: {one.text}") for one in warnings]
    return tuple(found)


_OTHER_FRICTION = 0.1
"""Part of the friction by which that of the whole robot may differ from that of the motor side."""


def compare_friction(choice: FrictionChoice, fitted: Mapping[str, FrictionValues]) -> tuple[Notice, ...]:
    """Return a warning for joints with measured loads whose friction the whole robot has changed."""
    found = []
    for k, law in enumerate(choice.joints):
        friction = fitted[law.joint]
        if law.selection is None or not choice.motion.measured[k] or friction.values is None:
            continue
        inputs = [gather_inputs(signals, slice(None), k) for signals in choice.motion.signals]
        own, whole = (
            np.concatenate([compute_columns(get_law(one.law), part, one.shape) for part in inputs])
            @ np.array(one.values)
            for one in (law.friction, friction)
        )
        # A constant is an error of the sensor, or a weight.
        apart = float(np.std(whole - own) / max(np.std(own), 1e-300))
        if apart > _OTHER_FRICTION:
            text = (
                f"joint {law.joint!r}: friction fitted with the whole robot differs by {100.0 * apart:.2g} % "
                "from that of the motor side alone (motor torque less measured load): the links carry what "
                "their model lacks, or the load has another factor. For friction without a model of the "
                "links, identify with --rows friction"
            )
            found.append(Notice(code="identify.load-friction", text=text))
    return tuple(found)


def _describe_choice(state: _State, table: JointTable, joint: int, *, measured: bool) -> LawSelection:
    """Return the trials of a joint, by what they leave of held-out torque, and why the law was taken."""
    trials, behind, taken = state.trials[joint], state.behind[joint], state.taken[joint]
    whole, rows = float(np.sum(table.grams[:, -1, -1])), int(table.rows.sum())
    plain = next((float(trial.own.sum()) for trial in trials if trial.law.name == PLAIN), None)
    listed = [
        LawTrial(
            law=trial.law.name,
            unknowns=len(trial.law.linear) + len(trial.law.shape),
            held_percent=100.0 * float(np.sqrt(trial.own.sum() / whole)),
            held_rms=float(np.sqrt(trial.own.sum() / rows)),
            ratio=float(trial.own.sum()) / plain if plain else None,
            behind=float(distance) if np.isfinite(distance) else None,
            reason=f"not identifiable: {', '.join(trial.weak)}" if trial.weak else "",
        )
        for trial, distance in zip(trials, behind, strict=True)
    ]
    own = listed[taken]
    what = "the motor's torque less the load" if measured else "the torque"
    text = f"{own.law} leaves {own.held_percent:.3g} % of {what} of held-out windows in motion"
    listed.sort(key=lambda entry: entry.held_rms or np.inf)
    best = next((entry for entry in listed if not entry.reason), own)
    if best is not own and own.unknowns < best.unknowns:
        text += (
            f"; {best.law}, with {best.unknowns} values instead of {own.unknowns}, predicts no surely better"
        )
    if own.ratio is not None and own.law != PLAIN:
        text += f"; {PLAIN} leaves {own.held_percent / np.sqrt(own.ratio):.3g} %"
    return LawSelection(trials=tuple(listed), chosen=own.law, verdict=f"{text}.", blocks=len(table.rows))


_COMPARED = 4
"""Passes over all data with all laws: nodes, closer nodes, and two linear steps about the best."""
_PASSES = 6
"""All passes; in the last ones the laws that were chosen settle."""


def _move_tangent(tangent: TangentLaw, linear: FloatArray, speeds: FloatArray) -> TangentLaw:
    law = get_law(tangent.name)
    return tangent.move(linear.tolist(), [bound_shape(law, k, speeds) for k in range(len(law.shape))])


def _approach(trial: _Trial, speeds: FloatArray, step: int) -> Wanted:
    """Return what to try next of a law: closer nodes after the first pass, then the law made linear there."""
    law = get_law(trial.law.name)
    if not law.shape:
        return [(law, ())]
    if not step:
        return [(law, shape) for shape in refine_nodes(law, trial.node.shape, speeds)]
    if isinstance(trial.law, TangentLaw):
        return [(_move_tangent(trial.law, trial.linear, speeds), ())]
    return [(TangentLaw.build(law, trial.node.shape, trial.linear.tolist()), ())]
