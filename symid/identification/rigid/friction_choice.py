"""The friction law of every joint, chosen on held-out torque inside the identification of the whole robot.

Library with plain friction, recordings, laws -> a law with its shape values for every joint, and all trials.

    tau_j = X_j x + sum_k c_k Phi_k(dq_j, load_j, ..; s) + noise,    x: base parameters, coupled drives
    M = sum_(i != j) w_i S_i + w_j G_j,    K = M_DD - M_Dx M_xx^-1 M_xD,    c = K_cc^-1 K_cy

The columns of all laws at all nodes of their shape values stand side by side in one table a joint
(`friction_tables`), as sums of products G, S without the joint's own friction. What is shared with other
joints is eliminated (variable projection, Golub and Pereyra 1973), so that a law at a node is a problem of a
few unknowns. Joints take turns until no law changes; then laws are made linear about their best nodes (Gauss
and Newton), until shape values stay. Of the identifiable laws the plainest is taken that no other one surely
predicts better than on stretches left out (`judge.measure_inferiority`).

Where a fit with a stated law leaves out slow rows, they may contradict more than themselves: a law with more
friction in slow motion is tried as well. Neither may surely predict better: how far each of them moves the
values of friction is, by its weight, an error of the model (Buckland, Burnham and Augustin 1997).

Where the load of a joint was measured behind its gear, its law is chosen from the torque of the motor less
the load: X_j x are then torques of rotors, and what the model of the links lacks is in neither.

Supported: every static law; loads measured or computed from the estimate, iterated with it; joints that keep
a law. Not supported: laws with a state; friction of drives that turn several joints, which stays.
"""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence, Set as AbstractSet
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.errors import IdentifiabilityError, Notice
from symid.identification.estimators import LawSelection, LawTrial
from symid.identification.judge import POLICY, compare, measure_inferiority, numerics
from symid.identification.regression import Rotor, scale_products, warn_of_load_gain
from symid.identification.rigid import friction_tables
from symid.identification.rigid.friction_tables import JointTable, Node, TangentLaw, Wanted
from symid.joint_models import (
    NO_FRICTION,
    FrictionLaw,
    FrictionValues,
    compute_columns,
    get_law,
    is_braking,
)
from symid.logs import Recording
from symid.notation import join_name
from symid.robot import Processing

PLAIN = "coulomb-viscous-offset"
"""What other laws are compared with."""


class _Reduced(NamedTuple):
    """A joint without its own friction: S of training sets, Q of parts that leave [-x 1] Q [-x 1]', rows."""

    schur: FloatArray
    left: FloatArray
    rows: int


def _solve(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Return the solution of normal equations (..., n, n) with right sides (..., n, k)."""
    scaled, scales = scale_products(matrix)
    return np.asarray(np.linalg.solve(scaled, right * scales[..., None]) * scales[..., None])


def _list_training(table: JointTable, places: Sequence[int]) -> FloatArray:
    """Return the sums (f + 1, k, k) over all stretches but one, and last over all."""
    grams = table.grams[:, places][:, :, places]
    whole = grams.sum(axis=0)
    folds = [whole - grams[table.fold == fold].sum(axis=0) for fold in range(int(table.fold.max()) + 1)]
    return np.stack([*folds, whole])


def _reduce(table: JointTable, node: Node) -> _Reduced:
    """Return a joint without the friction of a law of its table."""
    p, c = table.shared, len(node.places)
    order = [*(p + k for k in node.places), *range(p), table.grams.shape[1] - 1]
    sets = _list_training(table, order)
    gains = _solve(sets[:, :c, :c], sets[:, :c, c:]) if c else np.zeros((len(sets), 0, p + 1))
    schur = sets[:, c:, c:] - sets[:, c:, :c] @ gains
    held = table.grams[:, order][:, :, order]
    # [f; x'] of a part with f = g_y - g_x x: columns of [-x 1].
    lift = np.concatenate([-gains[table.fold], np.tile(np.eye(p + 1), (len(held), 1, 1))], axis=1)
    return _Reduced(schur, np.swapaxes(lift, 1, 2) @ held @ lift, max(int(table.rows.sum()), 1))


class Trial(NamedTuple):
    """A law on a joint: best node, linear values, squares.

    `own` (b,) are those of held-out parts, `losses` (b,) with the other joints', weighted as in the fit;
    `fitted` is what the fit to all rows leaves; `weak` names what is not identifiable.
    """

    law: FrictionLaw
    node: Node
    linear: FloatArray
    losses: FloatArray
    own: FloatArray
    fitted: float
    weak: tuple[str, ...]

    @property
    def unknowns(self) -> int:
        """Return the number of values of the law."""
        return len(self.law.linear) + len(self.law.shape)

    @property
    def shape(self) -> tuple[float, ...]:
        """Return the shape values of the law."""
        return self.law.about if isinstance(self.law, TangentLaw) else self.node.shape


def _find_braking(law: FrictionLaw) -> list[int]:
    """Return which linear parameters of a law drive the joint where they are negative."""
    return [place for place, entry in enumerate(law.linear) if is_braking(entry.name)]


def _try_laws(table: JointTable, schur: FloatArray, left: FloatArray) -> list[Trial]:
    """Return a trial of every law of a table; S and Q are sums over the other joints, in its weight."""
    p, size = table.shared, table.grams.shape[1]
    sets = _list_training(table, range(size))
    outer = sets[:, :p, :].copy()
    outer[:, :, :p] += schur[:, :p, :p]
    outer[:, :, -1] += schur[:, :p, -1]
    gains = _solve(outer[:, :, :p], outer[:, :, p:])
    inner = sets[:, p:, p:] - np.swapaxes(outer[:, :, p:], 1, 2) @ gains
    inner[:, -1, -1] += schur[:, -1, -1]
    # What the rigid columns are like differs from them by their filter alone.
    before, after = (np.maximum(np.diagonal(part[-1])[:-1], 0.0) for part in (sets[:, p:, p:], inner))
    alike = after <= numerics.CONVERGED * before
    found = []
    for _, group in itertools.groupby(table.nodes, key=lambda node: node.law.name):
        nodes = list(group)
        places = np.array([node.places for node in nodes], dtype=np.intp)
        matrix = inner[:, places[:, :, None], places[:, None, :]]
        right = inner[:, places, -1]
        linear = _solve(matrix, right[..., None])[..., 0]
        losses = inner[:, -1, -1][:, None] - np.sum(right * linear, axis=2)
        # Friction that drives its joint imitates something else, where shape values without it are at hand.
        drives = np.any(linear[:, :, _find_braking(nodes[0].law)] < 0.0, axis=2)
        kept = ~drives | np.all(drives, axis=1, keepdims=True)
        best = np.argmin(np.where(kept, losses, np.inf), axis=1)
        # [-x -c 1] of each training set.
        factors = np.zeros((len(sets), size))
        factors[:, -1] = 1.0
        for h, k in enumerate(best):
            chosen = list(nodes[k].places)
            factors[h, :p] = gains[h][:, chosen] @ linear[h, k] - gains[h, :, -1]
            # Columns that agree in these logs are one of the table.
            np.subtract.at(factors[h], [p + place for place in chosen], linear[h, k])
        held = factors[table.fold]
        own = np.einsum("bk,bkl,bl->b", held, table.grams, held)
        rest = held[:, [*range(p), size - 1]]
        k = int(best[-1])
        node = nodes[k]
        order: list[int] = []
        if node.places:
            weak = alike[list(node.places)]
            # Linear parameters with a part in a direction that the rows do not determine.
            sizes, vectors = np.linalg.eigh(scale_products(matrix[-1, k])[0])
            poor = sizes < numerics.RANK * sizes[-1]
            lost = np.any(np.abs(vectors[:, poor]) > 1e-3, axis=1)
            order = [*np.flatnonzero(weak), *np.flatnonzero(lost & ~weak)]
        losses = own + np.einsum("bk,bkl,bl->b", rest, left, rest)
        fitted = float(factors[-1] @ table.grams.sum(axis=0) @ factors[-1])
        names = tuple(node.law.linear[place].name for place in order)
        found.append(Trial(node.law, node, linear[-1, k], losses, own, fitted, names))
    return found


class Choice(NamedTuple):
    """Places of the candidate taken and of the best one; (k,) chances that each is as good as the best."""

    taken: int
    best: int
    chances: FloatArray


def choose_plainest(
    losses: FloatArray, unknowns: Sequence[int], order: Sequence[int | tuple[bool, int]]
) -> Choice:
    """Return the candidate of fewest `unknowns` (k,) that no other one surely surpasses.

    `losses` (k, parts) are squares of held-out parts. Of several as plain and as good, the first by `order`
    (k,) is taken, such as the number of shape values, which only imitate others.
    """
    totals = losses.sum(axis=1)
    best = int(np.argmin(totals))
    tests = {k: compare(own[:, None], losses[best][:, None]) for k, own in enumerate(losses) if k != best}
    sure = measure_inferiority(losses)
    matters = {k for k, one in tests.items() if one.fall_of_all > 1.0 + POLICY.relevance}
    near = [k for k in range(len(losses)) if k not in matters or sure[k] >= POLICY.caution]
    chances = np.array([tests[k].p_of_all if k in tests else 1.0 for k in range(len(losses))])

    def rank(place: int) -> tuple[int, bool, int | tuple[bool, int], float]:
        worse = place in matters and bool(chances[place] < POLICY.caution)
        return unknowns[place], worse, order[place], float(totals[place])

    return Choice(min(near, key=rank), best, chances)


def choose_trial(trials: Sequence[Trial]) -> Choice:
    """Return the choice among the trials that are identifiable, chances 0 of the others."""
    whole = [k for k, trial in enumerate(trials) if not trial.weak]
    # Where no law is identifiable, the plainest one leaves least open.
    whole = whole or [min(range(len(trials)), key=lambda k: trials[k].unknowns)]
    # What a law costs the other joints counts as well.
    beside = np.min([trial.losses - trial.own for trial in trials], axis=0)

    def rank(trial: Trial) -> tuple[bool, int]:
        """Return whether friction of a law drives its joint, and the number of its shape values."""
        driving = bool(np.any(trial.linear[_find_braking(trial.law)] < 0.0))
        return driving, len(trial.law.about if isinstance(trial.law, TangentLaw) else trial.law.shape)

    taken, best, chances = choose_plainest(
        np.array([trials[k].losses - beside for k in whole]),
        [trials[k].unknowns for k in whole],
        [rank(trials[k]) for k in whole],
    )
    found = np.zeros(len(trials))
    found[whole] = chances
    return Choice(whole[taken], whole[best], found)


class Search(NamedTuple):
    """Laws of all joints: table, node and trials of each, and the choice; x (p,) of the fit with them."""

    tables: Sequence[JointTable]
    nodes: Sequence[Node]
    shared: FloatArray
    trials: Sequence[Sequence[Trial]]
    choices: Sequence[Choice]

    @property
    def taken(self) -> list[Trial]:
        """Return the trial of every joint that was taken."""
        return [trials[choice.taken] for trials, choice in zip(self.trials, self.choices, strict=True)]


def _solve_shared(reduced: Sequence[_Reduced], weights: FloatArray) -> FloatArray:
    """Return x (p,) of the fit to all rows."""
    whole = np.tensordot(weights, [one.schur[-1] for one in reduced], 1)
    return _solve(whole[:-1, :-1], whole[:-1, -1:])[:, 0]


def _weigh(reduced: Sequence[_Reduced], weights: FloatArray) -> FloatArray:
    """Return weights (n,) from the mean squares that a fit leaves of every joint."""
    u = np.append(-_solve_shared(reduced, weights), 1.0)
    return 1.0 / np.maximum([u @ one.schur[-1] @ u / one.rows for one in reduced], numerics.TINY)


def _settle_laws(tables: Sequence[JointTable], start: Sequence[Node]) -> Search:
    """Return the laws after the joints took turns until none changed."""
    nodes, count, reduced = list(start), len(tables), list(map(_reduce, tables, start))
    weights = np.ones(count)
    for _ in range(3):
        weights = _weigh(reduced, weights)
    trials: list[Sequence[Trial]] = [()] * count
    choices = [Choice(0, 0, np.zeros(0))] * count
    for _ in range(numerics.ROUNDS):
        before = [node.law.name for node in nodes]
        for joint, table in enumerate(tables):
            shares = np.where(np.arange(count) == joint, 0.0, weights / weights[joint])
            schur, left, _ = (np.tensordot(shares, parts, 1) for parts in zip(*reduced, strict=True))
            trials[joint] = _try_laws(table, schur, left)
            choices[joint] = choose_trial(trials[joint])
            nodes[joint] = trials[joint][choices[joint].taken].node
            reduced[joint] = _reduce(table, nodes[joint])
            weights = _weigh(reduced, weights)
        if before == [node.law.name for node in nodes]:
            break
    return Search(tables, nodes, _solve_shared(reduced, weights), trials, choices)


def search_laws(
    tabulate: Callable[[Sequence[Wanted], FloatArray | None], Sequence[JointTable]],
    wanted: Sequence[Wanted],
    speeds: Sequence[FloatArray],
) -> Search:
    """Return the laws of all joints once laws and shape values stay.

    Args:
        tabulate: returns tables of laws, with loads of the shared parameters (p,) found last, None at first.
        wanted: of each joint, laws at their first nodes.
        speeds: (N,) of each joint, rad/s or m/s; none of one whose shape values stay.
    """
    laws, shared = [PLAIN] * len(wanted), None
    for step in range(numerics.ROUNDS):
        tables = tabulate(wanted, shared)
        # The first node of a law in a table, or of the table where it has no such law.
        begun = [
            next((node for node in table.nodes if node.law.name == law), table.nodes[0])
            for table, law in zip(tables, laws, strict=True)
        ]
        found = _settle_laws(tables, begun)
        shared = found.shared
        before, laws = laws, [node.law.name for node in found.nodes]
        if step and laws == before and all(map(_stays, found.taken, speeds)):
            break
        pairs = zip(found.trials, speeds, strict=True)
        wanted = [[_approach(trial, own) for trial in trials] for trials, own in pairs]
    return found


def _approach(trial: Trial, speeds: FloatArray) -> tuple[FrictionLaw, tuple[float, ...]]:
    """Return a law made linear about the shape values that a trial found; as it is where these stay."""
    if isinstance(trial.law, TangentLaw):
        return trial.law.move(trial.linear.tolist(), speeds), ()
    if trial.law.shape and len(speeds):
        return TangentLaw.build(trial.law, trial.node.shape, trial.linear.tolist()), ()
    return trial.law, trial.node.shape


def _read_values(trial: Trial, speeds: FloatArray) -> FrictionValues:
    """Return the law of a trial with its values, those of the shape after its last step."""
    law, shape = _approach(trial, speeds)
    if isinstance(law, TangentLaw):
        return FrictionValues(law=law.name, values=law.values, shape=law.about)
    return FrictionValues(law=law.name, values=tuple(trial.linear.tolist()), shape=shape)


def _stays(trial: Trial, speeds: FloatArray) -> bool:
    """Return whether shape values moved by less than matters, or do not move."""
    law, _ = _approach(trial, speeds)
    known = law.about if isinstance(law, TangentLaw) else ()
    before = trial.law.about if isinstance(trial.law, TangentLaw) else (np.inf,) * len(known)
    return np.allclose(known, before, rtol=POLICY.relevance, atol=0.0)


_LAWS = (
    *("coulomb-viscous", "asymmetric", "tustin", "stribeck", "lorentzian", "cubic", "power-law"),
    *("load-dependent", "load-dependent-stribeck", "stribeck+cubic", "stribeck-exponent", "makkar"),
    *("position-dependent", "position-torque", "temperature", "temperature-viscous"),
)
CANDIDATES = (
    *(name for law in _LAWS for name in (law, get_law(f"{law}+offset").name) if name != "asymmetric+offset"),
    *("improved-stribeck", "asymmetric-stribeck"),
)
"""Laws among which `auto` chooses; waves of the motor's angle are added where a gear is known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JointLaw:
    """The friction of a joint, and how its law was chosen: None where it hardly moves, or keeps its law.

    `tried` are all laws with their values and weights, of sum one, by the chances that they predict best.
    """

    joint: str
    friction: FrictionValues
    selection: LawSelection | None = None
    tried: tuple[tuple[FrictionValues, float], ...] = ()


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
    motion: friction_tables.Motion
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
    motion = friction_tables.prepare_motion(library, recordings, processing, rotors=rotors)
    count = library.card.size
    wishes = wishes or (CANDIDATES,) * count
    tables = friction_tables.tabulate_laws(motion, [[(get_law(PLAIN), ())]] * count)
    # With fewer windows than parts to be scored, no law can be chosen.
    moving = [int(table.rows.sum()) >= POLICY.folds * POLICY.parts for table in tables]
    reduced = [_reduce(table, table.nodes[0]) for table in tables]
    motion = friction_tables.load_joints(motion, _solve_shared(reduced, _weigh(reduced, np.ones(count))))
    inputs = set.intersection(
        *(set(friction_tables.gather_inputs(one, slice(0, 1), 0)) for one in motion.signals)
    )
    lacking = []
    for card, wish in zip(library.card.joints, wishes, strict=True):
        name, *more = (wish.law,) if isinstance(wish, FrictionValues) else wish
        if not more and name != NO_FRICTION and (missing := set(get_law(name).inputs) - inputs):
            what = " and ".join(sorted(missing))
            text = f"joint {card.name!r}: the friction law {name!r} reads the {what}, which not all logs "
            text += f"have: name its columns in [log.{min(missing)}], or take another law"
            lacking.append(Notice(code="identify.friction-input", text=text))
    if lacking:
        raise IdentifiabilityError(*lacking)
    free = [own and not isinstance(wish, FrictionValues) for own, wish in zip(moving, wishes, strict=True)]
    # The speeds of each joint at all samples that count.
    whole = np.abs(np.concatenate([entry.dq for entry in motion.signals])).T
    speeds = [
        own[own >= slow] if is_free else own[:0]
        for own, slow, is_free in zip(whole, motion.slowest, free, strict=True)
    ]
    calls = zip(wishes, gears, speeds, strict=True)
    wanted = [_list_wanted(wish, gear, inputs, own) for wish, gear, own in calls]

    def tabulate(wanted: Sequence[Wanted], shared: FloatArray | None) -> list[JointTable]:
        loaded = motion if shared is None else friction_tables.load_joints(motion, shared)
        return friction_tables.tabulate_laws(loaded, wanted)

    search = search_laws(tabulate, wanted, speeds)
    found = []
    for joint, (card, trial, wish) in enumerate(zip(library.card.joints, search.taken, wishes, strict=True)):
        friction = _read_values(trial, speeds[joint])
        if isinstance(wish, FrictionValues):
            friction = replace(wish, values=friction.values)
        selection: LawSelection | None = None
        chances, trials = search.choices[joint].chances, search.trials[joint]
        weights = chances / max(float(chances.sum()), numerics.TINY)
        tried = [
            (_read_values(one, speeds[joint]), w) for one, w in zip(trials, weights.tolist(), strict=True)
        ]
        if free[joint]:
            what = "the motor's torque less the load" if motion.measured[joint] else "the torque"
            given = search.tables[joint], trials, search.choices[joint]
            selection = describe_choice(*given, f"{what} in motion", card.torque_unit)
        found.append(JointLaw(joint=card.name, friction=friction, selection=selection, tried=tuple(tried)))
    motion = friction_tables.load_joints(motion, search.shared)
    notices, beta = _judge_loads(motion, found, search.nodes), search.shared[: len(library.card.beta)]
    return FrictionChoice(joints=tuple(found), beta=beta, motion=motion, notices=notices)


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
    return [(law, shape) for law in laws for shape in friction_tables.list_shape_nodes(law, speeds)]


def _judge_loads(
    motion: friction_tables.Motion, laws: Sequence[JointLaw], nodes: Sequence[Node]
) -> tuple[Notice, ...]:
    """Return what was done with measured loads, and warnings where these have another gain."""
    judged = [k for k, law in enumerate(laws) if law.selection is not None and motion.measured[k]]
    names = ", ".join(repr(laws[k].joint) for k in judged)
    text = f"joint{'s'[: len(judged) > 1]} {names}: friction laws were chosen from the torque of the motor "
    text += "less the measured load, rotor inertias fitted jointly, so that errors of the link model do not "
    text += "enter; their values are then fitted with the whole robot"
    found = [Notice(code="identify.measured-load", text=text)] if judged else []
    for k in judged:
        warnings = warn_of_load_gain(friction_tables.measure_gain(motion, k, nodes[k].law, nodes[k].shape))
        found += [replace(one, text=f"joint {laws[k].joint!r}: {one.text}") for one in warnings]
    return tuple(found)


_BENT = {"coulomb-viscous": "stribeck", PLAIN: "stribeck+offset"}
"""Laws with more friction in slow motion, by those that lack it; their other values mean the same."""


def measure_law_errors(
    library: Library,
    recordings: Sequence[Recording],
    processing: Processing,
    slow: Sequence[bool],
    values: FloatArray,
) -> tuple[FloatArray, tuple[Notice, ...]]:
    """Return how far laws move the values of friction, rows (k, p) that add up as squares, and notices.

    Where `slow` rows (n,) contradict a law, and were left out, what they contradict may reach into the rows
    that were kept. The law and one with more friction in slow motion are fitted to all rows in motion; each
    counts as often as it would predict best, so that the difference between laws that predict alike is a part
    of the uncertainty of the `values` (p,).
    """
    card, found, notices = library.card, list[FloatArray](), list[Notice]()
    wishes: list[Wish] = []
    for joint, doubted in zip(card.joints, slow, strict=True):
        bent = _BENT.get(joint.friction)
        plain = FrictionValues() if joint.friction == NO_FRICTION else (PLAIN,)
        wishes.append((joint.friction, bent) if bent and doubted else plain)
    if not any(len(wish) > 1 for wish in wishes if not isinstance(wish, FrictionValues)):
        return np.zeros((0, len(values))), ()
    choice = choose_laws(library, recordings, processing, gears=[1.0] * card.size, wishes=wishes)
    for joint, law in zip(card.joints, choice.joints, strict=True):
        if law.selection is None or len(law.tried) < 2:
            continue
        for friction, weight in law.tried:
            pairs = zip(get_law(friction.law).linear, friction.values or (), strict=True)
            own = {join_name(entry.name, joint.number): value for entry, value in pairs}
            # A law that drives its joint imitates something else.
            if any(is_braking(name) and value < 0.0 for name, value in own.items()):
                continue
            moved = {k: entry.name for k, entry in enumerate(card.fitted) if entry.name in own}
            error = np.zeros(len(values))
            error[list(moved)] = [math.sqrt(weight) * (own[name] - values[k]) for k, name in moved.items()]
            found.append(error)
            if friction.law == law.friction.law != joint.friction:
                text = f"joint {joint.name!r}: in slow motion, too, {law.selection.verdict} The standard "
                text += f"deviations of {', '.join(moved.values())} include the change by that law; "
                text += "to take it, state this law for the joint"
                notices.append(Notice(code="identify.friction-law", text=text))
    return np.array(found).reshape(-1, len(values)), tuple(notices)


def compare_friction(choice: FrictionChoice, fitted: Mapping[str, FrictionValues]) -> tuple[Notice, ...]:
    """Return a warning for joints with measured loads whose friction the whole robot has changed."""
    found = []
    for k, law in enumerate(choice.joints):
        friction = fitted[law.joint]
        if law.selection is None or not choice.motion.measured[k] or friction.values is None:
            continue
        inputs = [friction_tables.gather_inputs(signals, slice(None), k) for signals in choice.motion.signals]
        own, whole = (
            np.concatenate([compute_columns(get_law(one.law), part, one.shape) for part in inputs])
            @ np.array(one.values)
            for one in (law.friction, friction)
        )
        # A constant is an error of the sensor, or a weight.
        apart = 100.0 * float(np.std(whole - own) / max(np.std(own), numerics.TINY))
        if apart > POLICY.good:
            text = f"joint {law.joint!r}: friction fitted with the whole robot differs by {apart:.2g} % from "
            text += "that of the motor side alone (motor torque less measured load): the link model has "
            text += "errors, or the factor of the load is wrong. For friction without a model of the links, "
            text += "identify with --rows friction"
            found.append(Notice(code="identify.load-friction", text=text))
    return tuple(found)


def describe_choice(
    table: JointTable, trials: Sequence[Trial], choice: Choice, what: str, unit: str
) -> LawSelection:
    """Return the trials of a joint by what they leave of `what` that was held out, and why one was taken."""
    whole, rows = max(float(np.sum(table.grams[:, -1, -1])), numerics.TINY), int(table.rows.sum())
    plain = next((float(trial.own.sum()) for trial in trials if trial.law.name == PLAIN), None)
    # How far a trial is behind the best, in standard errors.
    behind = np.maximum(-scipy.special.stdtrit(len(table.rows) - 1, choice.chances), 0.0)
    listed = [
        LawTrial(
            law=trial.law.name,
            unknowns=trial.unknowns,
            fitted_percent=100.0 * math.sqrt(max(trial.fitted, 0.0) / whole),
            held_percent=100.0 * math.sqrt(trial.own.sum() / whole),
            held_rms=math.sqrt(trial.own.sum() / rows),
            ratio=float(trial.own.sum()) / plain if plain else None,
            behind=float(distance) if np.isfinite(distance) else None,
            reason=f"not identifiable: {', '.join(trial.weak)}" if trial.weak else "",
        )
        for trial, distance in zip(trials, behind, strict=True)
    ]
    own, best = listed[choice.taken], listed[choice.best]
    size = f"{own.held_percent:.3g} % of {what} ({own.held_rms:.3g} {unit} RMS)"
    text = f"{own.law} has a held-out residual of {size}"
    if own.reason:
        text = f"No law is identifiable from these logs; {own.law}, the simplest, is given in part"
    elif any(entry.reason and (entry.held_rms or 0.0) < (own.held_rms or 0.0) for entry in listed):
        text = f"Of the identifiable laws, {text}"
    if own.unknowns < best.unknowns:
        text += f"; {best.law}, with {best.unknowns} values instead of {own.unknowns}"
        text += ", is not significantly better"
    if own.ratio is not None and own.law != PLAIN and not own.reason:
        text += f"; {PLAIN} has {(own.held_percent or 0.0) / math.sqrt(own.ratio):.3g} %"
    listed.sort(key=lambda entry: entry.held_rms or np.inf)
    return LawSelection(trials=tuple(listed), chosen=own.law, verdict=f"{text}.", blocks=len(table.rows))
