"""Springs with hysteresis along whole recordings: plays, torque, inverse, work, energy.

Torsion or torque (N,), `Elasticity` or weights and thresholds -> plays, torque, torsion, energies (N,); the
equations are those of `hysteresis`. `memory` has the play of each stop before the first sample, None is the
virgin spring, all zero. Samples may be any distance apart, as long as the input is monotone between them.

    sum of plays   y = w_0 x + sum_i w_i P_i[x],   rises for W_i = w_0 + ... + w_i > 0
    inverse        phi = sum_i w'_i P'_i[v],  stops have k_i = -w_i;  G the integral of S
    stored         U = sum_i w'_i [G(P'_i + r'_i) + G(P'_i - r'_i)] / 2
    lost           D = sum_i w'_i int [S(P'_i + r'_i) - S(P'_i - r'_i)] |dP'_i| / 2

The work is the change of U, plus D (Brokate and Sprekels, Hysteresis and Phase Transitions, 1996).

Not supported (RobotError): unknown stiffnesses; plays whose sum does not rise; the inverse of a cubic spring,
and its work and energy with knees.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.errors import Notice, RobotError
from symid.joint_models import hysteresis as elements
from symid.joint_models.branches import refuse_element
from symid.joint_models.carriers import OperatorCarrier, build_float_carrier, build_numpy_carrier
from symid.joint_models.hysteresis import Elasticity, SpringTerms

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


def compute_outer_torque(terms: SpringTerms[float], value: FloatArray) -> FloatArray:
    """Return S(v), N m or N, at values v of any shape."""
    return np.asarray(elements.compute_outer_function(_ARRAYS, value, terms.above, terms.below))


def invert_outer(terms: SpringTerms[float], torque: FloatArray) -> FloatArray:
    """Return v with S(v) = torque, N m or N, for torques of any shape."""
    above, below = (elements.invert_pieces(_FLOATS, 1.0, side) for side in (terms.above, terms.below))
    return np.asarray(elements.compute_outer_function(_ARRAYS, torque, above, below))


def compute_outer_integral(terms: SpringTerms[float], value: FloatArray) -> FloatArray:
    """Return G(v), the integral of S from 0 to v, at values v of any shape."""
    return np.asarray(elements.compute_outer_integral(_ARRAYS, value, terms.above, terms.below))


@dataclass(frozen=True, slots=True, kw_only=True)
class PlayModel(elements.Plays[float]):
    """A sum of plays: w_0 .. w_m, and r_1 .. r_m, positive and increasing, in the unit of the input."""

    thresholds: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        """Raise a RobotError for thresholds out of order, a count that does not fit, or no rise."""
        mistakes = []
        if len(self.weights) != len(self.thresholds) + 1:
            mistakes.append(f"{len(self.thresholds)} thresholds need {len(self.thresholds) + 1} weights")
        if any(not low < high for low, high in zip((0.0, *self.thresholds), self.thresholds, strict=False)):
            mistakes.append("the thresholds of plays must be positive and increase, each once")
        if not all(slope > 0 for slope in np.cumsum(self.weights)):
            mistakes.append("w_0 + ... + w_i must be positive for every i: else the model does not rise")
        refuse_element(mistakes)


def build_play_model(elasticity: Elasticity) -> PlayModel:
    """Return the plays of an elasticity, knees and cubic part left out: w_0 = k0 + sum k_i, w_i = -k_i."""
    plays = elements.gather_plays(_FLOATS, read_spring_terms(elasticity))
    return PlayModel(weights=plays.weights, thresholds=plays.thresholds)


def invert_play_model(
    model: PlayModel, memory: Sequence[float] | FloatArray | None = None
) -> tuple[PlayModel, FloatArray]:
    """Return the inverse of a model, and the memory (m,) that the inverse has where the model has `memory`.

    w'_0 = 1 / w_0, w'_i = -w_i / (W_i W_{i-1}), r'_i = sum_{j <= i} w_j (r_i - r_j),
    P'_i = W_i P_i + sum_{j > i} w_j P_j.

    Raises:
        RobotError: no history leaves such a memory: |P_i - P_{i+1}| <= r_{i+1} - r_i, up to rounding.
    """
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
    if mistakes:
        raise RobotError(*(Notice(code="robot.impossible-memory", text=text) for text in mistakes))
    inverse = elements.invert_plays(_FLOATS, model)
    image = np.array(elements.invert_plays_memory(_FLOATS, model, plays.tolist()))
    return PlayModel(weights=inverse.weights, thresholds=inverse.thresholds), image


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


def compute_play_output(model: PlayModel, values: FloatArray, memory: Memory = None) -> FloatArray:
    """Return w_0 x + sum_i w_i P_i[x] (N,) for an input (N,) and the plays (m,) before it."""
    values, weights = np.asarray(values, dtype=np.float64), np.array(model.weights)
    plays = compute_plays(values, np.array(model.thresholds), memory)
    return np.asarray(weights[0] * values + plays @ weights[1:], dtype=np.float64)


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
    torque = compute_outer_torque(terms, inner)
    return torque if dphi is None else torque + elasticity.damping * np.asarray(dphi, dtype=np.float64)


def invert_hysteresis(elasticity: Elasticity, torque: FloatArray, memory: Memory = None) -> FloatArray:
    """Return the torsion (N,) at which an elastic joint has the torque (N,), N m or N, damping left out.

    `memory` has the plays of the torsion, as for `compute_hysteresis_torque`; a RobotError where no history
    of the torsion leaves such a one.
    """
    _refuse_cubic(elasticity)
    inverse, image = invert_play_model(build_play_model(elasticity), memory)
    value = invert_outer(read_spring_terms(elasticity), np.asarray(torque, dtype=np.float64))
    return compute_play_output(inverse, value, image)


def compute_work_columns(phi: FloatArray, thresholds: FloatArray, memory: Memory = None) -> FloatArray:
    """Return the work (N, m + 1) since the first sample per unit of k0, k_1 .. k_m.

    phi^2 / 2, and E_i^2 / 2 + r_i times the way of P_i, less their values at the first sample.
    """
    phi = np.asarray(phi, dtype=np.float64)
    plays = compute_plays(phi, thresholds, memory)
    stored = 0.5 * np.square(np.column_stack([phi, phi[:, None] - plays]))
    columns = stored - stored[:1]
    columns[:, 1:] += thresholds * np.cumsum(np.abs(_diff(plays)), axis=0)
    return columns


def compute_inverse_plays(
    elasticity: Elasticity, phi: FloatArray, memory: Memory = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return P'_i (N, m + 1), r'_i and w'_i (m + 1,) of phi = sum_i w'_i P'_i[v]; P'_0 = v, r'_0 = 0.

    P'_i = W_i P_i - sum_{j > i} k_j P_j with W_i = k0 + sum_{j > i} k_j.
    """
    _refuse_cubic(elasticity)
    inverse, _ = invert_play_model(build_play_model(elasticity))
    terms, radii, weights = _read_spring(elasticity)
    plays = np.column_stack([phi, compute_plays(phi, radii, memory)])
    weights = np.concatenate([[0.0], weights])
    slopes = terms.stiffness + np.sum(weights) - np.cumsum(weights)
    shares = np.diag(slopes) - np.tril(np.broadcast_to(weights[:, None], (weights.size,) * 2), -1)
    return plays @ shares, np.array((0.0, *inverse.thresholds)), np.array(inverse.weights)


def _refuse_cubic(elasticity: Elasticity) -> None:
    """Refuse a cubic part where the closed form is that of plays."""
    if elasticity.cubic:
        text = (
            "a cubic spring has no inverse in closed form, nor, together with knees, a closed form of its "
            "work; describe its hardening by knees alone"
        )
        raise RobotError(Notice(code="robot.cubic-spring", text=text))


def _diff(values: FloatArray) -> FloatArray:
    """Return the steps (N, m) of columns, the first ones zero."""
    return np.diff(values, axis=0, prepend=values[:1])


def compute_spring_work(elasticity: Elasticity, phi: FloatArray, memory: Memory = None) -> FloatArray:
    """Return the work (N,) in J done on the spring since the first sample, damping left out."""
    phi = np.asarray(phi, dtype=np.float64)
    terms, radii, weights = _read_spring(elasticity)
    if not elasticity.knees:
        columns = compute_work_columns(phi, radii, memory)
        quartic = 0.25 * elasticity.cubic * (phi**4 - phi[:1] ** 4)
        weights = np.concatenate([[terms.stiffness], weights])
        return np.asarray(columns @ weights + quartic, dtype=np.float64)
    plays, radii, weights = compute_inverse_plays(elasticity, phi, memory)
    ways = _diff(plays)
    # While it moves up a play trails its input by the threshold, and leads it while it moves down.
    edges = np.sign(ways) * radii
    ends = compute_outer_integral(terms, plays + edges)
    starts = compute_outer_integral(terms, plays - ways + edges)
    return np.cumsum((ends - starts) @ weights)


def compute_stored_energy(elasticity: Elasticity, phi: FloatArray, memory: Memory = None) -> FloatArray:
    """Return the energy U (N,) in J that the spring holds along its torsion (N,); virgin at rest none."""
    if elasticity.knees:
        _refuse_cubic(elasticity)
    phi = np.asarray(phi, dtype=np.float64)
    terms, radii, _ = _read_spring(elasticity)
    plays = compute_plays(phi, radii, memory)
    stored = elements.compute_stored(_ARRAYS, terms, phi, list(plays.T))
    rest = elements.compute_stored(_FLOATS, terms, 0.0, [0.0] * len(radii))
    return np.asarray(np.asarray(stored) - np.asarray(rest), dtype=np.float64)


def compute_dissipation(elasticity: Elasticity, phi: FloatArray, memory: Memory = None) -> FloatArray:
    """Return the energy D (N,) in J lost since the first sample, damping left out; it never decreases.

    Without knees D = sum_i k_i r_i int |dP_i|.
    """
    phi = np.asarray(phi, dtype=np.float64)
    terms, radii, weights = _read_spring(elasticity)
    if not elasticity.knees:
        return np.cumsum(np.abs(_diff(compute_plays(phi, radii, memory))) @ (weights * radii))
    plays, radii, weights = compute_inverse_plays(elasticity, phi, memory)
    gaps = compute_outer_integral(terms, plays + radii) - compute_outer_integral(terms, plays - radii)
    steps = np.maximum(0.5 * np.sign(_diff(plays)) * _diff(gaps), 0.0)
    return np.cumsum(steps @ weights)
