"""Equations condensed by QR, their rank, and the parameters that can be identified from them.

Rows, all at once or block by block -> Condensed (a triangle for each group) -> Identifiability.

    [A_g y_g] = Q_g F_g,  so that  |A_g x - y_g| = |F_g [x; -1]|  for every x

By Householder transformations, block after block; normal equations, which square the condition number, are
never formed. A parameter is identifiable if no direction in the null space has a part of it; directions are
the right singular vectors of the matrix with its columns scaled to length one.

Supported: any number of rows, full and deficient rank; columns that are zero in a group cost nothing.
Not supported: losses other than squares (they need the rows); a verdict on precision: poorly identifiable
parameters are fitted, and have a large standard deviation.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray, compute_triangle, cut_pieces, freeze
from symid.errors import IdentifiabilityError, Notice, shorten_names
from symid.identification.judge import numerics
from symid.identification.regression.equations import Rows
from symid.logs import Recording, Signals

_KNOWN: WeakKeyDictionary[Rows, "Condensed"] = WeakKeyDictionary()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Condensed:
    """The triangles of groups of rows.

    `factors` (g, p + 1, p + 1) are the upper triangles F of [A y], rows scaled by the root of their weight;
    `counts` (g,) rows of each group; `independent` rows of independent noise that they are worth, as a
    fraction.
    """

    factors: FloatArray
    counts: NDArray[np.intp]
    independent: float


class CondensedSolution(NamedTuple):
    """The least-squares solution (p,); the covariance is the variance of the noise times root root'.

    `leverage` (g,) is how many parameters the rows of each group determine; `condition` that of the
    column-scaled matrix.
    """

    values: FloatArray
    leverage: FloatArray
    root: FloatArray
    condition: float


def extend_triangle(triangle: FloatArray, blocks: Iterable[FloatArray]) -> FloatArray:
    """Return the triangle (k, k) of its own rows and those of `blocks` (m, k).

    Columns without any entry are left out of the work. The input is not changed.
    """
    size = triangle.shape[1]
    upper = triangle[triangle.any(axis=1)]
    for block in blocks:
        live = block.any(axis=0) | upper.any(axis=0)
        reduced = compute_triangle(np.vstack([upper[:, live], block[:, live]]))
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


def condense_weighted(rows: Rows, weight: FloatArray, *before: FloatArray) -> Condensed:
    """Return the triangles of the groups with `weight` (m,) in place of the rows' own; 0 leaves a row out.

    More columns (m, k) may stand `before` those of the rows.
    """
    groups, size = len(rows.group_names), sum(part.shape[1] for part in (*before, rows.matrix)) + 1
    factors = np.zeros((groups, size, size))
    counts = np.bincount(rows.group[weight != 0.0], minlength=groups).astype(np.intp)
    root = np.sqrt(weight)[:, None]
    for index in range(groups):
        places = np.flatnonzero(rows.group == index)
        # Rows that stand together are taken as a slice, which copies nothing.
        together = len(places) and places[-1] - places[0] + 1 == len(places)
        members = slice(int(places[0]), int(places[-1]) + 1) if together else places
        own, scales = [part[members] for part in (*before, rows.matrix, rows.values)], root[members]
        parts = (slice(start, start + numerics.BLOCK) for start in range(0, len(scales), numerics.BLOCK))
        blocks = (np.column_stack([entry[part] for entry in own]) * scales[part] for part in parts)
        factors[index] = extend_triangle(factors[index], blocks)
    return Condensed(factors=freeze(factors), counts=counts, independent=rows.independent)


def stack_condensed(condensed: Condensed, weights: FloatArray) -> FloatArray:
    """Return one triangle (p + 1, p + 1) of all groups, group g times weights[g]."""
    whole = (condensed.factors * np.asarray(weights)[:, None, None]).reshape(-1, condensed.factors.shape[2])
    return extend_triangle(np.zeros((0, whole.shape[1])), [whole])


def count_freedom(freedom: str, leverage: FloatArray, independent: float) -> tuple[FloatArray, float]:
    """Return the rows (g,) that parameters take from each group, and the part of the rows that counts.

    `freedom` as in `Processing.noise_freedom`; `leverage` and `independent` as in `CondensedSolution`.
    """
    part = independent if freedom == "band" else 1.0
    return leverage / (leverage.sum() if freedom == "one" else part), part


def compute_square_sums(condensed: Condensed, values: FloatArray) -> FloatArray:
    """Return |A_g x - y_g|^2 of every group for parameters x (p,): (g,), in the rows' units."""
    errors = condensed.factors @ np.append(values, -1.0)
    return np.asarray(np.sum(errors**2, axis=1))


def solve_condensed(condensed: Condensed, basis: FloatArray, weights: FloatArray) -> CondensedSolution:
    """Return the least-squares solution in the span of `basis` (p, r).

    `weights` (g,) are what residuals of each group are multiplied by.
    """
    triangle = stack_condensed(condensed, weights)
    count = int(basis.shape[1])
    matrix, target = triangle[:, :-1], triangle[:, -1]
    factor = compute_triangle(np.column_stack([matrix @ basis, target]))
    left, singular, right = np.linalg.svd(factor[:count, :count])
    values: FloatArray = basis @ (right.T @ ((left.T @ factor[:count, count]) / singular))
    scaled, root = compute_spectrum(matrix[:, basis.any(axis=1)]).singular, basis @ (right.T / singular)
    leverage = np.sum((condensed.factors[:, :, :-1] @ root) ** 2, axis=(1, 2)) * np.asarray(weights) ** 2
    return CondensedSolution(values, leverage, root, float(scaled[0] / scaled[count - 1]))


JOINT_AT_REST = "identify.joint-at-rest"
"""Code of the notice that the rows of a joint were left out because it does not move."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RankRule:
    """Limits below which something counts as zero.

    Args:
        zero: length of a column relative to the longest one.
        singular: singular value of the scaled matrix relative to the largest one; filters round at 1e-9.
        share: squared part of a direction in the null space in a parameter.
        least: share of all parameters that must be identifiable.
    """

    zero: float = numerics.RANK
    singular: float = 1e-7
    share: float = 1e-8
    least: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScaledSpectrum:
    """Singular values (p,) of a matrix with columns of length one, in falling order.

    `lengths` (p,) of the columns; `scales` (p,) their inverses, 1 for a column of zeros; row k of
    `directions` (p, p) belongs to singular value k.
    """

    lengths: FloatArray
    scales: FloatArray
    singular: FloatArray
    directions: FloatArray

    def mask_directions(self, rule: RankRule) -> NDArray[np.bool_]:
        """Return which directions are identifiable: (p,)."""
        return np.asarray(self.singular > rule.singular * self.singular[0])

    def mask_identifiable(self, rule: RankRule) -> NDArray[np.bool_]:
        """Return which parameters have no part in the null space: (p,)."""
        share = np.sum(self.directions[~self.mask_directions(rule)] ** 2, axis=0)
        return np.asarray((share <= rule.share) & (self.lengths > 0.0))

    def list_partners(self, index: int, rule: RankRule) -> list[int]:
        """Return the parameters that depend on parameter `index` in the null space, most dependent first."""
        null = self.directions[~self.mask_directions(rule)]
        partners = np.abs(null.T @ null[:, index])
        partners[index] = 0.0
        order = np.argsort(-partners, kind="stable").tolist()
        return [k for k in order if partners[k] ** 2 > rule.share]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Identifiability:
    """Which parameters can be identified from rows.

    `basis` (p, r) identifiable directions, of which the fit is a combination; the row of a parameter without
    any effect is zero. `identifiable` (p,) whether a parameter is; `refused` (name, reason) of the others,
    with a notice each; `condition` of the column-scaled matrix, over the identifiable directions.
    """

    basis: FloatArray
    identifiable: NDArray[np.bool_]
    refused: tuple[tuple[str, str], ...]
    condition: float
    notices: tuple[Notice, ...]


def compute_spectrum(matrix: FloatArray, zero: float = numerics.RANK) -> ScaledSpectrum:
    """Return the singular values of `matrix` (m, p) after scaling its columns to length one.

    Columns shorter than `zero` times the longest one count as zero.
    """
    lengths = np.linalg.norm(matrix, axis=0)
    alive = lengths > zero * max(lengths.max(initial=0.0), np.finfo(float).tiny)
    scales = np.where(alive, 1.0 / np.where(alive, lengths, 1.0), 1.0)
    triangle = compute_triangle(matrix) * (scales * alive)
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
    matrix: FloatArray, right: FloatArray, *, rcond: float | None = None, damping: float = 0.0
) -> FloatArray:
    """Return argmin |A x - b|^2 + damping |D x|^2, D the lengths of A's columns: (p,).

    A (m, p) and b (m,) are `matrix` and `right`. Columns are scaled to length one; of many solutions the one
    of least norm in these units is taken. Singular values below `rcond` times the largest count as zero.
    """
    lengths = np.linalg.norm(matrix, axis=0)
    lengths[lengths == 0.0] = 1.0
    scaled = matrix / lengths
    if damping:
        scaled = np.vstack([scaled, np.sqrt(damping) * np.eye(len(lengths))])
        right = np.concatenate([right, np.zeros(len(lengths))])
    return np.asarray(np.linalg.lstsq(scaled, right, rcond=rcond)[0] / lengths)


def analyse_identifiability(rows: Rows, rule: RankRule | None = None) -> Identifiability:
    """Return which parameters are identifiable from `rows`; an IdentifiabilityError for too few."""
    rule = rule or RankRule()
    if not len(rows.values):
        text = "this log gives no equation: wherever it is not cut off, its joints rest or are slower than "
        text += "processing.standstill. Record a longer log, or leave out less"
        raise IdentifiabilityError(Notice(code="identify.no-rows", text=text), *rows.notices)
    found = analyse_condensed(condense_rows(rows), rows.kind, rows.names, rule)
    check_identifiable_share(found, rows.names, rule.least, rows.notices)
    return found


def check_identifiable_share(
    found: Identifiability, names: tuple[str, ...], least: float, notices: tuple[Notice, ...] = ()
) -> None:
    """Raise IdentifiabilityError where less than `least` of the parameters `names` are identifiable.

    Every other one is named with the reason, after `notices` of joints at rest.
    """
    count = int(found.identifiable.sum())
    if count >= least * len(names):
        return
    text = f"only {count} of {len(names)} parameters are identifiable from these logs. Record a motion in "
    text += "which every joint accelerates on its own and turns both ways (`symid excite` makes one), add "
    text += "logs, or fit what is identifiable with --partial"
    # One line for a reason, however many parameters share it.
    shared: dict[str, list[str]] = {}
    for name, reason in found.refused:
        shared.setdefault(reason, []).append(name)
    texts = [text, *(f"not identifiable: {', '.join(some)}: {reason}" for reason, some in shared.items())]
    raise IdentifiabilityError(
        *(notice for notice in notices if notice.code == JOINT_AT_REST),
        *(Notice(code="identify.poor-log", text=text) for text in texts),
    )


def analyse_condensed(
    condensed: Condensed, kind: str, names: tuple[str, ...], rule: RankRule | None = None
) -> Identifiability:
    """Return which parameters are identifiable from condensed rows; see `analyse_identifiability`."""
    rule, count = rule or RankRule(), int(condensed.counts.sum())
    parameters = condensed.factors.shape[2] - 1
    if not np.any(condensed.factors[:, :, :-1]):
        raise _refuse_all()
    if count <= parameters:
        text = f"{count} {kind} equations are too few for {parameters} parameters and their uncertainty: use "
        text += "a longer log, a shorter window, less decimation, or torque equations"
        raise IdentifiabilityError(Notice(code="identify.too-few-rows", text=text))
    if not np.any(condensed.factors[:, :, -1]):
        text = "the measured torque is zero throughout: check the torque column of the log and its factor"
        raise IdentifiabilityError(Notice(code="identify.no-torque", text=text))
    # The triangles have the singular values of all rows.
    spectrum = compute_spectrum(condensed.factors[:, :, :-1].reshape(-1, len(names)), rule.zero)
    found, identifiable = spectrum.mask_directions(rule), spectrum.mask_identifiable(rule)
    refused = []
    for index in np.flatnonzero(~identifiable):
        shown = shorten_names((names[k] for k in spectrum.list_partners(int(index), rule)), 4)
        reason = f"acts only together with {shown}, in a fixed proportion throughout this log"
        if spectrum.lengths[index] == 0.0:
            reason = "acts on no measured torque of this log"
        refused.append((names[index], reason))
    if not identifiable.any():
        raise _refuse_all("; ".join(f"{name}: {reason}" for name, reason in refused))
    texts = [f"parameter {name} was left out: {reason}; move it on its own" for name, reason in refused]
    basis = np.where(spectrum.lengths > 0.0, spectrum.scales, 0.0)[:, None] * spectrum.directions[found].T
    return Identifiability(
        basis=freeze(basis),
        identifiable=identifiable,
        refused=tuple(refused),
        condition=float(spectrum.singular[0] / spectrum.singular[found][-1]),
        notices=tuple(Notice(code="identify.refused", text=text) for text in texts),
    )


def _refuse_all(reasons: str = "") -> IdentifiabilityError:
    text = f"no parameter is identifiable from this log{f' ({reasons})' if reasons else ''}"
    text = f"{text}: record a log in which the joints move"
    return IdentifiabilityError(Notice(code="identify.nothing", text=text))


def list_resting_joints(recording: Recording) -> tuple[int, ...]:
    """Return the joints whose range of positions is less than twenty times the encoder's noise.

    The noise is that of second differences d: sigma = |d|_rms / sqrt(6). An encoder that flips between
    neighbouring ticks rests.
    """
    parts = [
        (piece.min(axis=1), piece.max(axis=1), np.sum(np.diff(piece, n=2) ** 2, axis=1))
        for piece in cut_pieces(recording.position, 2)
    ]
    lows, highs, squares = map(np.array, zip(*parts, strict=True))
    low, high, count = lows.min(axis=0), highs.max(axis=0), max(1, len(recording.position) - 2)
    noise = np.sqrt(squares.sum(axis=0) / count / 6.0)
    # Below this, a range is rounding of the position itself.
    rounding = 16.0 * float(np.finfo(float).eps) * np.maximum(-low, high)
    return tuple(np.flatnonzero(high - low <= np.maximum(20.0 * noise, rounding)).tolist())


def hold_resting_joints(
    signals: Signals, resting: tuple[int, ...], places: Sequence[float] | None = None
) -> Signals:
    """Return the signals with the given joints exactly at rest, at `places` or else at their mean position.

    Encoder noise would pass for motion, and its sign for the direction of dry friction.
    """
    if not resting:
        return signals
    joints = list(resting)
    q, dq, ddq = signals.q.copy(), signals.dq.copy(), signals.ddq.copy()
    q[:, joints] = q[:, joints].mean(axis=0) if places is None else places
    dq[:, joints] = ddq[:, joints] = 0.0
    return replace(signals, q=q, dq=dq, ddq=ddq)
