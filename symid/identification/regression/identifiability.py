"""Equations condensed by QR, their rank, and the parameters that can be identified from them.

Input: rows, all at once or block by block. Output: `Condensed`, one triangle per group of rows;
`ScaledSpectrum`; `Identifiability`: the directions of the parameter space that the rows determine, and the
parameters that they do not.

    [A_g y_g] = Q_g F_g,  so that  |A_g x - y_g| = |F_g [x; -1]|  for every x

By Householder transformations, block after block: the triangle so far is put on top of the next block and
factorised again. The normal equations, which square the condition number, are never formed.

A parameter is identifiable if no direction that the rows cannot see has a part of it. The directions are
the right singular vectors of the matrix with its columns scaled to length one.

Supported: any number of rows, full and deficient rank; columns that are zero in a group cost nothing.
Not supported: losses other than squares, residuals row by row (both need the rows); a verdict on precision:
a poorly identifiable parameter is fitted, and its standard deviation says how poorly.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray, freeze
from symid.errors import IdentifiabilityError, Notice
from symid.identification.regression.equations import Rows
from symid.logs import Recording, Signals

BLOCK = 4096
"""Rows that are factorised at once: a block and its factor stay in the cache of a core."""
_KNOWN: WeakKeyDictionary[Rows, "Condensed"] = WeakKeyDictionary()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Condensed:
    """The triangles of groups of rows.

    Args:
        factors: (g, p + 1, p + 1) upper triangles F of [A y], rows scaled by the root of their weight.
        counts: (g,) rows of each group.
        independent: rows of independent noise that the rows are worth, as a fraction of them.
    """

    factors: FloatArray
    counts: NDArray[np.intp]
    independent: float = 1.0

    @property
    def parameters(self) -> int:
        """Return the number p of parameters."""
        return int(self.factors.shape[2]) - 1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CondensedSolution:
    """The least-squares solution of condensed rows.

    Args:
        values: (p,); root: (p, r) such that the covariance is the noise's variance times root root'.
        square: sum of the weighted squares that remain.
        condition: of the column-scaled matrix, weighted.
    """

    values: FloatArray
    root: FloatArray
    square: float
    condition: float


def extend_triangle(triangle: FloatArray, blocks: Iterable[FloatArray]) -> FloatArray:
    """Return the triangle (k, k) of all rows that it stands for and those of `blocks` (m, k).

    Columns without any entry are left out of the work. The input is not changed.
    """
    size = triangle.shape[1]
    upper = triangle[triangle.any(axis=1)]
    for block in blocks:
        live = block.any(axis=0) | upper.any(axis=0)
        stacked = np.vstack([upper[:, live], block[:, live]])
        reduced = np.linalg.qr(stacked, mode="r")
        upper = np.zeros((len(reduced), size))
        upper[:, live] = reduced
    full = np.zeros((size, size))
    full[: len(upper)] = upper
    return full


def condense_rows(rows: Rows) -> Condensed:
    """Return the triangles of the rows' groups; the same rows are factorised once."""
    found = _KNOWN.get(rows)
    if found is None:
        found = _KNOWN[rows] = condense_weighted(rows, rows.weight)
    return found


def condense_weighted(rows: Rows, weight: FloatArray) -> Condensed:
    """Return the triangles of the groups with `weight` (m,) in place of the rows' own; 0 leaves a row out."""
    groups, size = len(rows.group_names), rows.matrix.shape[1] + 1
    factors = np.zeros((groups, size, size))
    counts = np.zeros(groups, dtype=np.intp)
    root = None if np.all(weight == 1.0) else np.sqrt(weight)
    for index in range(groups):
        members = _locate_members(rows, index)
        part = None if root is None else root[members]
        counts[index] = len(rows.values[members]) if part is None else np.count_nonzero(part)
        factors[index] = extend_triangle(factors[index], _cut_blocks(rows, members, part))
    return Condensed(factors=freeze(factors), counts=counts, independent=rows.independent)


def _locate_members(rows: Rows, index: int) -> slice | NDArray[np.intp]:
    """Return where the rows of a group stand: a slice where they stand together, so that none is copied."""
    members = np.flatnonzero(rows.group == index)
    if len(members) and members[-1] - members[0] + 1 == len(members):
        return slice(int(members[0]), int(members[-1]) + 1)
    return members


def _cut_blocks(
    rows: Rows, members: slice | NDArray[np.intp], root: FloatArray | None
) -> Iterable[FloatArray]:
    matrix, values = rows.matrix[members], rows.values[members]
    for start in range(0, len(values), BLOCK):
        part = slice(start, start + BLOCK)
        block = np.column_stack([matrix[part], values[part]])
        yield block if root is None else block * root[part, None]


def stack_condensed(condensed: Condensed, weights: FloatArray) -> FloatArray:
    """Return one triangle (p + 1, p + 1) of all groups, group g times weights[g]."""
    whole = (condensed.factors * np.asarray(weights)[:, None, None]).reshape(-1, condensed.factors.shape[2])
    return extend_triangle(np.zeros((0, whole.shape[1])), [whole])


def count_freedom(freedom: str, parameters: int, independent: float) -> tuple[int, float]:
    """Return how many degrees of freedom parameters take from rows, and the part of the rows that counts.

    Args:
        freedom: how the variance of the noise is estimated, see `Processing.noise_freedom`.
        parameters: that were fitted.
        independent: rows of independent noise that the rows are worth, as a fraction of them.
    """
    return (1 if freedom == "one" else parameters, independent if freedom == "band" else 1.0)


def compute_square_sums(condensed: Condensed, values: FloatArray) -> FloatArray:
    """Return |A_g x - y_g|^2 of every group for parameters x (p,): (g,), in the rows' units."""
    errors = condensed.factors @ np.append(values, -1.0)
    sums: FloatArray = np.sum(errors**2, axis=1)
    return sums


def solve_condensed(condensed: Condensed, basis: FloatArray, weights: FloatArray) -> CondensedSolution:
    """Return the least-squares solution in the span of `basis`.

    Args:
        condensed: the equations.
        basis: (p, r) directions that the rows see.
        weights: (g,) what residuals of each group are multiplied by.
    """
    triangle = stack_condensed(condensed, weights)
    count = int(basis.shape[1])
    matrix, target = triangle[:, :-1], triangle[:, -1]
    factor: FloatArray = np.asarray(np.linalg.qr(np.column_stack([matrix @ basis, target]), mode="r"))
    left, singular, right = np.linalg.svd(factor[:count, :count])
    values: FloatArray = basis @ (right.T @ ((left.T @ factor[:count, count]) / singular))
    return CondensedSolution(
        values=values,
        root=basis @ (right.T / singular),
        square=float(np.sum((matrix @ values - target) ** 2)),
        condition=_compute_condition(matrix[:, basis.any(axis=1)], count),
    )


def _compute_condition(matrix: FloatArray, count: int) -> float:
    """Return the ratio of the first to the last of `count` singular values, columns scaled to length one."""
    lengths = np.linalg.norm(matrix, axis=0)
    singular = np.linalg.svd(matrix / np.where(lengths > 0.0, lengths, 1.0), compute_uv=False)
    return float(singular[0] / singular[count - 1])


WHOLE_MODEL = 0.75
"""Part of a robot's parameters that logs must tell to be called enough for a model of the robot."""
JOINT_AT_REST = "identify.joint-at-rest"
"""Code of the notice that the rows of a joint were left out because it does not move."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RankRule:
    """When something counts as not seen.

    `zero` is the length of a column relative to the longest one, `singular` a singular value of
    the scaled matrix relative to the largest one, `share` the squared part of an unseen
    direction in a parameter. `least` is the part of all parameters that must be seen.
    """

    zero: float = 1e-10
    singular: float = 1e-7
    share: float = 1e-8
    least: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScaledSpectrum:
    """Singular values of a matrix with columns of length one, in falling order.

    Args:
        lengths: (p,) of the columns; scales: (p,) their inverses, 1 for a column of zeros.
        singular: (p,); directions: (p, p), row k belongs to singular value k.
    """

    lengths: FloatArray
    scales: FloatArray
    singular: FloatArray
    directions: FloatArray

    def mask_seen(self, rule: RankRule) -> NDArray[np.bool_]:
        """Return which directions the rows see: (p,)."""
        return np.asarray(self.singular > rule.singular * self.singular[0])

    def mask_identifiable(self, rule: RankRule) -> NDArray[np.bool_]:
        """Return which parameters have no part in a direction that the rows do not see: (p,)."""
        share = np.sum(self.directions[~self.mask_seen(rule)] ** 2, axis=0)
        return np.asarray((share <= rule.share) & (self.lengths > 0.0))

    def list_partners(self, index: int, rule: RankRule) -> list[int]:
        """Return the parameters that trade against parameter `index` in what is not seen, closest first."""
        hidden = self.directions[~self.mask_seen(rule)]
        # The projector on the unseen directions.
        partners = np.abs(hidden.T @ hidden[:, index])
        partners[index] = 0.0
        order = np.argsort(-partners, kind="stable").tolist()
        return [k for k in order if partners[k] ** 2 > rule.share]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Identifiability:
    """What rows can tell.

    Args:
        basis: (p, r) directions that the rows see; the fit is a combination of them. The row
            of a parameter without any effect is zero.
        learnable: (p,) whether a parameter has a value of its own.
        refused: (name, reason) of the others.
        condition: of the column-scaled matrix, over the directions seen.
        notices: one for every refused parameter.
    """

    basis: FloatArray
    learnable: NDArray[np.bool_]
    refused: tuple[tuple[str, str], ...]
    condition: float
    notices: tuple[Notice, ...]


def compute_spectrum(matrix: FloatArray, zero: float = 0.0) -> ScaledSpectrum:
    """Return the singular values of `matrix` (m, p) after scaling its columns to length one.

    Columns shorter than `zero` times the longest one count as zero. By QR first, so that the
    cost of the singular value decomposition does not depend on m.
    """
    lengths = np.linalg.norm(matrix, axis=0)
    alive = lengths > zero * max(lengths.max(initial=0.0), np.finfo(float).tiny)
    scales = np.where(alive, 1.0 / np.where(alive, lengths, 1.0), 1.0)
    triangle = np.linalg.qr(matrix, mode="r") * (scales * alive)
    _, singular, directions = np.linalg.svd(triangle)
    padded = np.zeros(matrix.shape[1])
    padded[: len(singular)] = singular
    return ScaledSpectrum(
        lengths=freeze(np.where(alive, lengths, 0.0)),
        scales=freeze(scales),
        singular=freeze(padded),
        directions=freeze(directions),
    )


def solve_scaled(
    matrix: FloatArray,
    right: FloatArray,
    *,
    rcond: float | None = None,
    low: FloatArray | float = -np.inf,
    high: FloatArray | float = np.inf,
    damping: float = 0.0,
) -> FloatArray:
    """Return argmin |A x - b|^2 + damping |D x|^2, low <= x <= high, D the lengths of A's columns: (p,).

    Columns are scaled to length one; of many solutions the one of least norm in these units is taken.

    Args:
        matrix: A (m, p).
        right: b (m,).
        rcond: singular value of the scaled matrix, relative to the largest, below which it counts as zero.
        low: (p,) or one number; with bounds, `rcond` has no part in it.
        high: (p,) or one number.
        damping: relative to the squares of the columns.
    """
    lengths = np.linalg.norm(matrix, axis=0)
    lengths[lengths == 0.0] = 1.0
    scaled = matrix / lengths
    if damping:
        scaled = np.vstack([scaled, np.sqrt(damping) * np.eye(len(lengths))])
        right = np.concatenate([right, np.zeros(len(lengths))])
    if np.all(np.isneginf(low)) and np.all(np.isposinf(high)):
        return np.asarray(np.linalg.lstsq(scaled, right, rcond=rcond)[0] / lengths)
    from scipy.optimize import lsq_linear

    triangle: FloatArray = np.asarray(np.linalg.qr(np.column_stack([scaled, right]), mode="r"))
    bounds = (low * lengths, high * lengths)
    answer = lsq_linear(triangle[:, :-1], triangle[:, -1], bounds=bounds, method="bvls", tol=1e-14)
    return np.asarray(np.clip(answer.x / lengths, low, high))


def analyse_identifiability(rows: Rows, rule: RankRule | None = None) -> Identifiability:
    """Return which parameters `rows` can tell, and which not.

    Raises:
        IdentifiabilityError: none can be learnt, or fewer than the rule wants, or there are not more rows
            than parameters.
    """
    rule = rule or RankRule()
    if not len(rows.values):
        text = (
            "no equation is left of this log: its joints are slower than processing.standstill, or stand "
            "still, wherever it is not cut off; record a longer log, or leave out less"
        )
        raise IdentifiabilityError(Notice(code="identify.no-rows", text=text), *rows.notices)
    seen = analyse_condensed(condense_rows(rows), rows.kind, rows.names, rule)
    check_identifiable_share(seen, rows.names, rule.least, rows.notices)
    return seen


def check_identifiable_share(
    seen: Identifiability, names: tuple[str, ...], least: float, notices: tuple[Notice, ...] = ()
) -> None:
    """Check that rows can tell enough for a model of the whole robot.

    Args:
        seen: what they tell.
        names: of all parameters.
        least: part of the parameters that must be learnable.
        notices: of the rows; what they say of joints at rest is told first.

    Raises:
        IdentifiabilityError: fewer are; every parameter that is not is named with the reason.
    """
    count = int(seen.learnable.sum())
    if count >= least * len(names):
        return
    text = (
        f"these logs tell only {count} of {len(names)} parameters, too few for a model of this robot: record "
        "a motion in which every joint accelerates on its own and turns both ways (`symid excite` makes "
        "one), or name further logs; --partial fits what can be told"
    )
    # One line for a reason, however many parameters share it.
    reasons = dict.fromkeys(reason for _, reason in seen.refused)
    told = (
        (", ".join(name for name, reason in seen.refused if reason == shared), shared) for shared in reasons
    )
    raise IdentifiabilityError(
        *(notice for notice in notices if notice.code == JOINT_AT_REST),
        Notice(code="identify.poor-log", text=text),
        *(Notice(code="identify.poor-log", text=f"not told: {some}: {reason}") for some, reason in told),
    )


def analyse_condensed(
    condensed: Condensed, kind: str, names: tuple[str, ...], rule: RankRule | None = None
) -> Identifiability:
    """Return which parameters condensed rows of a kind can tell; see `analyse_identifiability`."""
    rule = rule or RankRule()
    _check_rows(condensed, kind)
    # The triangles have the singular values of all rows.
    spectrum = compute_spectrum(condensed.factors[:, :, :-1].reshape(-1, condensed.parameters), rule.zero)
    seen, learnable = spectrum.mask_seen(rule), spectrum.mask_identifiable(rule)
    refused = tuple(
        (name, _explain_unidentifiable(index, names, spectrum, rule))
        for index, name in enumerate(names)
        if not learnable[index]
    )
    if not learnable.any():
        raise IdentifiabilityError(_say_nothing(refused))
    notices = tuple(
        Notice(code="identify.refused", text=f"parameter {name} was left out: {reason}")
        for name, reason in refused
    )
    return Identifiability(
        basis=freeze(
            np.where(spectrum.lengths > 0.0, spectrum.scales, 0.0)[:, None] * spectrum.directions[seen].T
        ),
        learnable=learnable,
        refused=refused,
        condition=float(spectrum.singular[0] / spectrum.singular[seen][-1]),
        notices=notices,
    )


def _check_rows(condensed: Condensed, kind: str) -> None:
    count, parameters = int(condensed.counts.sum()), condensed.parameters
    if not np.any(condensed.factors[:, :, :-1]):
        raise IdentifiabilityError(_say_nothing(()))
    if count <= parameters:
        text = (
            f"{count} {kind} rows cannot determine {parameters} parameters and their scatter: "
            "use a longer log, a shorter window, less decimation, or torque rows"
        )
        raise IdentifiabilityError(Notice(code="identify.too-few-rows", text=text))
    if not np.any(condensed.factors[:, :, -1]):
        text = "the measured torque is zero throughout: check the torque column of the log and its factor"
        raise IdentifiabilityError(Notice(code="identify.no-torque", text=text))


def _say_nothing(refused: tuple[tuple[str, str], ...]) -> Notice:
    reasons = "; ".join(f"{name}: {reason}" for name, reason in refused)
    text = "nothing can be learnt from this log" + (f" ({reasons})" if reasons else "")
    return Notice(code="identify.nothing", text=f"{text}: record a log in which the joints move")


def _explain_unidentifiable(
    index: int, names: tuple[str, ...], spectrum: ScaledSpectrum, rule: RankRule
) -> str:
    """Return why parameter `index` cannot be learnt."""
    if spectrum.lengths[index] == 0.0:
        return "it does not act on any measured torque in this log"
    others = [names[k] for k in spectrum.list_partners(index, rule)]
    shown = ", ".join(others[:4]) + (f" and {len(others) - 4} more" if len(others) > 4 else "")
    return f"it acts only together with {shown}, in a fixed proportion throughout this log"


def list_resting_joints(recording: Recording) -> tuple[int, ...]:
    """Return the joints that do not move in a recording.

    A joint moves if the range of its position is more than twenty times the noise, which is
    taken from second differences d: sigma = |d|_rms / sqrt(6) for white noise. An encoder that
    flips between neighbouring ticks rests.
    """
    position = recording.position
    spread = np.ptp(position, axis=0)
    noise = np.sqrt(np.mean(np.diff(position, n=2, axis=0) ** 2, axis=0) / 6.0)
    # Below this, a range is rounding of the position itself.
    rounding = 16.0 * np.finfo(float).eps * np.max(np.abs(position), axis=0)
    resting = spread <= np.maximum(20.0 * noise, rounding)
    return tuple(int(joint) for joint in np.flatnonzero(resting))


def hold_resting_joints(signals: Signals, resting: tuple[int, ...]) -> Signals:
    """Return the signals with the given joints exactly at rest, at their mean position.

    What differentiation makes of encoder noise at standstill is no motion; least of all is its
    sign the direction of dry friction.
    """
    if not resting:
        return signals
    joints = list(resting)
    q, dq, ddq = signals.q.copy(), signals.dq.copy(), signals.ddq.copy()
    q[:, joints] = q[:, joints].mean(axis=0)
    dq[:, joints] = 0.0
    ddq[:, joints] = 0.0
    return Signals(time=signals.time, q=q, dq=dq, ddq=ddq, tau=signals.tau, period=signals.period)
