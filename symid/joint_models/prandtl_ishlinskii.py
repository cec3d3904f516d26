"""Springs with hysteresis along whole recordings: plays, torque, inverse, work, losses.

Torsion or torque (N,), `Elasticity` or weights and thresholds -> plays, torque, torsion, energies (N,); the
equations are those of `hysteresis`. `memory` has the play of each stop before the first sample, None is the
virgin spring, all zero. Samples may be any distance apart, as long as the input is monotone between them.

    sum of plays   y = w_0 x + sum_i w_i P_i[x],   rises for W_i = w_0 + ... + w_i > 0
    inverse        phi = sum_i w'_i P'_i[v],  stops have k_i = -w_i;  G the integral of S
    stored         U = sum_i w'_i [G(P'_i + r'_i) + G(P'_i - r'_i)] / 2
    lost           D = sum_i w'_i int [S(P'_i + r'_i) - S(P'_i - r'_i)] |dP'_i| / 2

The work is the change of U, plus D (Brokate and Sprekels, Hysteresis and Phase Transitions, 1996).

Not supported (RobotError): unknown stiffnesses; plays whose sum does not rise; the inverse of a cubic spring,
and its work and losses with knees.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.errors import Notice, RobotError
from symid.joint_models import hysteresis as elements
from symid.joint_models.branches import refuse_element
from symid.joint_models.carriers import OperatorCarrier, build_float_carrier, build_numpy_carrier
from symid.joint_models.hysteresis import Elasticity, Plays, SpringTerms

Memory = FloatArray | None
"""The play of each stop before the first sample; None for the virgin spring."""
_FLOATS = build_float_carrier()
_ARRAYS: OperatorCarrier[Any] = build_numpy_carrier()
_ROUNDING = 1e-9


def read_spring_terms(elasticity: Elasticity) -> SpringTerms[float]:
    """Return the numbers of an elasticity for the float carrier; its branches, backlash and offset apart."""
    if elasticity.initial_stiffness is None or elasticity.stiffness is None:
        text = "a stiffness of the spring is unknown; state it in the robot file, or identify it"
        raise RobotError(Notice(code="robot.unknown-stiffness", text=text))
    knees = elasticity.knees
    return SpringTerms(
        stiffness=elasticity.stiffness,
        cubic=elasticity.cubic or None,
        stops=tuple((stop.threshold, stop.stiffness or 0.0) for stop in elasticity.stops),
        above=tuple((knee.threshold, knee.slope) for knee in knees if knee.threshold > 0),
        below=tuple((knee.threshold, knee.slope) for knee in reversed(knees) if knee.threshold < 0),
    )


def _read_spring(elasticity: Elasticity) -> tuple[SpringTerms[float], FloatArray, FloatArray]:
    """Return the numbers of an elasticity, and r_i and k_i of its stops as arrays (m,)."""
    terms = read_spring_terms(elasticity)
    pairs = np.array(terms.stops, dtype=np.float64).reshape(-1, 2)
    return terms, pairs[:, 0], pairs[:, 1]


class PlayPath(NamedTuple):
    """An input (N,) that plays follow: from one turn to the next each is a clamp of its state at the former.

    `turns` (T,) are its values there, `own` (M,) those asked for, `former` (M,) the turn before each.
    """

    values: FloatArray
    turns: FloatArray
    own: FloatArray
    former: NDArray[np.intp]

    @classmethod
    def build(cls, values: FloatArray, kept: slice | NDArray[np.intp] = slice(None)) -> "PlayPath":
        """Return the path of an input (N,) for those samples that are `kept`, a slice or their places."""
        turns = find_turns(values)
        former = np.append(0, np.repeat(np.arange(len(turns) - 1), np.diff(turns)))
        return cls(values, values[turns], values[kept], former[: len(values)][kept])

    def follow(self, radii: FloatArray, memory: Memory = None) -> tuple[FloatArray, FloatArray]:
        """Return the plays at the turns (T, m) and at the samples asked for (M, m), stored by columns."""
        ends, edges = self.turns[:, None], radii[:, None]
        state = np.zeros(radii.size) if memory is None else np.asarray(memory, dtype=np.float64)
        begun = compute_clamps(ends - radii, ends + radii, state)
        states = np.take(begun.T, self.former, axis=1)
        np.maximum(self.own - edges, np.minimum(self.own + edges, states, out=states), out=states)
        return begun, states.T

    def follow_stops(self, radii: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return [x, E_1 .. E_m] of virgin stops at the turns (T, m + 1) and samples (M, m + 1), as above."""
        begun, states = self.follow(radii)
        whole = np.column_stack([self.turns, self.turns[:, None] - begun])
        return whole, np.vstack([self.own, self.own - states.T]).T


def compute_plays(values: FloatArray, thresholds: FloatArray, memory: Memory = None) -> FloatArray:
    """Return the plays (N, m) of an input (N,), exactly as sample after sample would give them.

    `thresholds` (m,) are not negative, of the input's unit; `memory` (m,): plays before, None for zeros.
    """
    path = PlayPath.build(np.asarray(values, dtype=np.float64))
    return path.follow(np.asarray(thresholds, dtype=np.float64), memory)[1]


def find_turns(values: FloatArray) -> NDArray[np.intp]:
    """Return the first sample, the last, and all where an input (N,) turns; all samples if one is NaN."""
    if len(values) < 2 or np.isnan(values).any():
        return np.arange(len(values))
    rising = np.diff(values) > 0.0
    return np.concatenate([[0], np.flatnonzero(rising[1:] != rising[:-1]) + 1, [len(values) - 1]])


def compute_clamps(
    lower: FloatArray, upper: FloatArray, state: FloatArray, turns: NDArray[np.intp] | None = None
) -> FloatArray:
    """Return s_k = max(lower_k, min(upper_k, s_k-1)) (N, m) from s_-1 = `state` (m,), lower <= upper (N, m).

    Clamps in a row are a clamp: blocks of samples become one each, the blocks are run through in order, then
    all blocks are filled at once. Where both bounds follow one input up and down, on the way from one of its
    `turns` to the next a state is a clamp of what it was at the former.
    """
    count = len(lower)
    if count == 0 or state.size == 0:
        return np.empty((count, state.size))
    if turns is not None and len(turns) < count:
        begun = compute_clamps(lower[turns], upper[turns], state)
        states = np.concatenate([begun[:1], np.repeat(begun[:-1], np.diff(turns), axis=0)])
        np.maximum(lower, np.minimum(upper, states, out=states), out=states)
        return states
    length = max(1, math.isqrt(count))
    blocks = -(-count // length)
    # Samples of one place in their blocks are contiguous: each pass of the loops works on one slab.
    places = np.minimum(np.arange(length)[:, None] + length * np.arange(blocks), count - 1)
    low_slabs, high_slabs = lower[places], upper[places]
    ends = np.stack([low_slabs[0], high_slabs[0]])
    for least, most in zip(low_slabs[1:], high_slabs[1:], strict=True):
        np.maximum(least, np.minimum(most, ends, out=ends), out=ends)
    entry = np.empty((blocks + 1, state.size))
    entry[0] = state
    for low, high, before, after in zip(*ends, entry[:-1], entry[1:], strict=True):
        np.maximum(low, np.minimum(high, before, out=after), out=after)
    states, before = np.empty((length, blocks, state.size)), entry[:-1]
    for least, most, out in zip(low_slabs, high_slabs, states, strict=True):
        np.maximum(least, np.minimum(most, before, out=out), out=out)
        before = out
    return np.ascontiguousarray(states.transpose(1, 0, 2)).reshape(-1, state.size)[:count]


def compute_stop_basis(phi: FloatArray, thresholds: FloatArray, kept: slice = slice(None)) -> FloatArray:
    """Return [phi, E_1 .. E_m] (N, m + 1); times k0, k_1 .. k_m they are the torque without knees.

    Of those samples that are `kept`.
    """
    return PlayPath.build(np.asarray(phi, dtype=np.float64), kept).follow_stops(thresholds)[1]


def compute_hysteresis_torque(
    elasticity: Elasticity, phi: FloatArray, dphi: FloatArray | None = None, memory: Memory = None
) -> FloatArray:
    """Return the torque (N,) of an elastic joint along its torsion.

    `phi` (N,) is the torsion theta - q, rad or m, `dphi` (N,) its rate; None leaves the damping out.
    `memory` (m,): plays before the first sample, rad or m; None for zeros.
    """
    terms, radii, weights = _read_spring(elasticity)
    phi = np.asarray(phi, dtype=np.float64)
    inner = terms.stiffness * phi + (phi[:, None] - compute_plays(phi, radii, memory)) @ weights
    if elasticity.cubic:
        inner = inner + elasticity.cubic * phi**3
    torque = np.asarray(elements.compute_outer_function(_ARRAYS, inner, terms.above, terms.below))
    return torque if dphi is None else torque + elasticity.damping * np.asarray(dphi, dtype=np.float64)


def invert_hysteresis(elasticity: Elasticity, torque: FloatArray, memory: Memory = None) -> FloatArray:
    """Return the torsion (N,) at which an elastic joint has the torque (N,), N m or N, damping left out.

    w'_0 = 1 / w_0, w'_i = -w_i / (W_i W_{i-1}), r'_i = sum_{j <= i} w_j (r_i - r_j),
    P'_i = W_i P_i + sum_{j > i} w_j P_j. `memory` has the plays of the torsion, as for
    `compute_hysteresis_torque`.

    Raises:
        RobotError: no history leaves such a memory: |P_i - P_{i+1}| <= r_{i+1} - r_i, up to rounding.
    """
    model, inverse = _invert_plays(elasticity)
    radii = np.array(model.thresholds)
    plays = np.zeros(radii.size) if memory is None else np.asarray(memory, dtype=np.float64)
    if radii.shape != plays.shape:
        mistakes = [f"the memory has {plays.size} plays; there are {radii.size} thresholds"]
    else:
        apart, allowed = np.abs(np.diff(plays)), np.diff(radii)
        slack = _ROUNDING * float(np.max(np.abs(plays), initial=0.0) + np.max(radii, initial=0.0))
        mistakes = [
            f"plays {k + 1} and {k + 2} are {apart[k]:g} apart; allowed is {allowed[k]:g}"
            for k in range(apart.size)
            if not apart[k] <= allowed[k] + slack
        ]
    RobotError.refuse(mistakes, code="robot.impossible-memory")
    terms = read_spring_terms(elasticity)
    sides = (elements.invert_pieces(_FLOATS, 1.0, side) for side in (terms.above, terms.below))
    value = elements.compute_outer_function(_ARRAYS, np.asarray(torque, dtype=np.float64), *sides)
    image = np.array(elements.invert_plays_memory(_FLOATS, model, plays.tolist()))
    images, weights = compute_plays(value, np.array(inverse.thresholds), image), np.array(inverse.weights)
    return np.asarray(weights[0] * value + images @ weights[1:], dtype=np.float64)


def _invert_plays(elasticity: Elasticity) -> tuple[Plays[float], Plays[float]]:
    """Return the plays of an elasticity, knees left out, and their inverse; refuse what has none."""
    if elasticity.cubic:
        text = "a cubic spring has no inverse in closed form, nor, together with knees, a closed form of its "
        text += "work; describe its hardening by knees alone"
        raise RobotError(Notice(code="robot.cubic-spring", text=text))
    plays = elements.gather_plays(_FLOATS, read_spring_terms(elasticity))
    if not all(slope > 0 for slope in np.cumsum(plays.weights)):
        refuse_element(["w_0 + ... + w_i must be positive for every i: else the spring does not rise"])
    return plays, elements.invert_plays(_FLOATS, plays)


def compute_work_columns(phi: FloatArray, thresholds: FloatArray, memory: Memory = None) -> FloatArray:
    """Return the work (N, m + 1) since the first sample per unit of k0, k_1 .. k_m.

    phi^2 / 2, and E_i^2 / 2 + r_i times the way of P_i, less their values at the first sample.
    """
    phi = np.asarray(phi, dtype=np.float64)
    plays = compute_plays(phi, thresholds, memory)
    stored = 0.5 * np.square(np.column_stack([phi, phi[:, None] - plays]))
    columns = stored - stored[:1]
    columns[:, 1:] += thresholds * np.cumsum(np.abs(np.diff(plays, axis=0, prepend=plays[:1])), axis=0)
    return columns


def compute_spring_work(elasticity: Elasticity, phi: FloatArray, memory: Memory = None) -> FloatArray:
    """Return the work (N,) in J done on the spring since the first sample, damping left out."""
    phi = np.asarray(phi, dtype=np.float64)
    terms, radii, weights = _read_spring(elasticity)
    if not elasticity.knees:
        columns = compute_work_columns(phi, radii, memory)
        quartic = 0.25 * elasticity.cubic * (phi**4 - phi[:1] ** 4)
        weights = np.concatenate([[terms.stiffness], weights])
        return np.asarray(columns @ weights + quartic, dtype=np.float64)
    # P'_0 = v, then P'_i, and r'_0 = 0.
    (model, inverse), plays = _invert_plays(elasticity), compute_plays(phi, radii, memory)
    value = model.weights[0] * phi + plays @ np.array(model.weights[1:])
    images = np.column_stack([value, *elements.invert_plays_memory(_ARRAYS, model, list(plays.T))])
    ways = np.diff(images, axis=0, prepend=images[:1])
    # While it moves up a play trails its input by the threshold, and leads it while it moves down.
    edges = np.sign(ways) * np.array((0.0, *inverse.thresholds))
    places, sides = (images + edges, images - ways + edges), (terms.above, terms.below)
    ends, starts = (elements.compute_outer_integral(_ARRAYS, place, *sides) for place in places)
    return np.cumsum((ends - starts) @ np.array(inverse.weights))
