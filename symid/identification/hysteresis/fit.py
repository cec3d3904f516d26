"""A bare element from its input and output: shapes searched, parts and model chosen by held-out prediction.

x, y, t -> `HysteresisRecord`.

    search      min |y - Phi(s) c| over shape values s, coefficients c eliminated, bounded where passive
                (variable projection, Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973) 413-432)
    held out    p_(-b) = p - step of least squares without block b, from derivatives at p; r = y - y(p_(-b))
    choice      least geometric mean of held-out mean squares, over blocks of time and the widest strokes; of
                models within half a standard error of it the one with the fewest parameters
    deviations  mean of the covariance for coloured residuals (spectral) and of the jackknife over blocks

Supported: uneven samples; a start from rest or either side; one recording, several for springs of joints.
Not supported: relays and nonlinear stops of several recordings; outputs noisier than they are large.
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from symid import joint_models
from symid.arrays import FloatArray, FrozenArrays, compute_triangle
from symid.codegen import run_compiled_branch
from symid.errors import Notice, UsageError
from symid.identification.hysteresis import spring_fit
from symid.identification.hysteresis.families import (
    BoucWenFamily,
    ElementFamily,
    ElementPath,
    NonlinearStops,
    RelayGrid,
    Stops,
    WithBacklash,
    WithRelaxation,
    list_families,
)
from symid.notation import HYSTERESIS_MODELS
from symid.options import HysteresisOptions
from symid.serialization import HIDDEN

_STARTS: tuple[joint_models.Start, ...] = ("zero", "fresh", "below", "above")
_LEAST_SAMPLES = 50
_SEARCHED = 3000
"""Samples of a search; more would only slow it down."""
_BLOCKS = 8
_WIDE = 0.7
"""Of the largest stroke: strokes above are held out together, where there are smaller ones too."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ElementParameter:
    """A number of an element, with its standard deviation; units are those of the input and the output."""

    name: str
    value: float
    deviation: float


@dataclass(frozen=True, slots=True, kw_only=True)
class HysteresisCandidate:
    """A model that was tried.

    Args:
        model: its name; form: what it has beside, in words.
        count: of parameters; passive: whether no motion gets work out of it.
        fitted: rms of the error over rms of the output about its mean, percent, of all samples; held_out: the
            same of samples left out; spread: standard error of the latter.
    """

    model: str
    form: str
    count: int
    passive: bool
    fitted: float
    held_out: float
    spread: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElementTrace(FrozenArrays):
    """Samples of the recording, at even places: time (M,) in s, input, measured and predicted output (M,)."""

    time: FloatArray
    position: FloatArray
    measured: FloatArray
    predicted: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HysteresisRecord(FrozenArrays):
    """An element that was identified.

    Args:
        model: its name; form: what it has beside; elasticity: the element.
        start: what it remembered at the first sample.
        parameters: all its numbers but those that are zero.
        candidates: all models that were tried, the best predicting first; passive: of the chosen one.
        fitted, held_out: as in `HysteresisCandidate`, percent.
        samples: number; skipped: of them, at the beginning, not fitted; span: least and largest input; speed:
            the largest; output: rms about its mean.
        timed: whether the time of the samples was known.
        trace: of the recording, for figures.
    """

    model: str
    form: str
    elasticity: joint_models.Elasticity = field(metadata=HIDDEN)
    start: joint_models.Start
    parameters: tuple[ElementParameter, ...]
    candidates: tuple[HysteresisCandidate, ...]
    passive: bool
    fitted: float
    held_out: float
    samples: int
    skipped: int = 0
    span: tuple[float, float]
    speed: float
    output: float
    timed: bool
    trace: ElementTrace = field(metadata=HIDDEN)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElementData:
    """A recording as the fit uses it: path and output (N,), thinned.

    `kept` (N,): samples that are fitted; the others, where what the element remembered is not known, are
    only followed.
    """

    path: ElementPath
    output: FloatArray
    kept: NDArray[np.bool_]

    @property
    def counted(self) -> FloatArray:
        """Return the output (M,) of the samples that are fitted."""
        return self.output[self.kept]

    def thin(self, most: int, *, turns: bool = False) -> "ElementData":
        """Return at most about `most` of the samples, at even places; and, with `turns`, where x turns."""
        every, path = max(1, len(self.output) // most), self.path
        if every == 1:
            return self
        taken = np.zeros(len(self.output), dtype=bool)
        taken[::every] = taken[list(path.begins)] = True
        if turns:
            share = _SMALL_TURN
            while len(strokes := find_strokes(path.position, share)) > most:
                # Noise turns as well: only what stands out of it counts.
                share *= 2.0
            taken[[low - 1 for low, _ in strokes[1:]]] = True
        index = np.flatnonzero(taken)
        thinned = replace(
            path,
            position=path.position[index],
            velocity=path.velocity[index],
            period=_measure_steps(np.cumsum(path.period)[index]),
            begins=tuple(np.searchsorted(index, path.begins).tolist()),
        )
        return ElementData(path=thinned, output=self.output[index], kept=self.kept[index])


def _measure_steps(time: FloatArray) -> FloatArray:
    """Return the lengths (N,) of the steps to times (N,), s: the first as the second."""
    steps = np.diff(time)
    return np.concatenate([steps[:1], steps])


_SMALL_TURN = 0.005


def check_recording(x: FloatArray, y: FloatArray, t: FloatArray | None) -> None:
    """Raise a UsageError, with all that is wrong, for what is no recording of an element."""
    mistakes = []
    if x.ndim != 1 or x.shape != y.shape or (t is not None and t.shape != x.shape):
        shapes = ", ".join(str(part.shape) for part in (x, y, *(() if t is None else (t,))))
        mistakes.append(f"input, output and time must be columns of one length, got {shapes}")
    elif len(x) < _LEAST_SAMPLES:
        mistakes.append(f"{len(x)} samples; at least {_LEAST_SAMPLES} are needed")
    for name, part in (("input", x), ("output", y), ("time", t)):
        if part is not None and not np.all(np.isfinite(part)):
            place = int(np.flatnonzero(~np.isfinite(part.ravel()))[0])
            mistakes.append(f"{name}: sample {place + 1} is not a finite number; leave such rows out")
        elif part is not None and name != "time" and part.size and not np.ptp(part) > 0.0:
            mistakes.append(f"{name}: all samples are {float(part.flat[0]):g}; it must move")
    if t is not None and t.ndim == 1 and np.all(np.isfinite(t)) and np.any(np.diff(t) <= 0.0):
        place = int(np.flatnonzero(np.diff(t) <= 0.0)[0])
        mistakes.append(f"time: sample {place + 2} is not later than the one before it")
    if mistakes:
        raise UsageError(*(Notice(code="usage.hysteresis-recording", text=text) for text in mistakes))


_SLOPE_NOISE = 0.01
"""Of the velocity's rms, what the noise of positions may leave in it."""


def compute_velocity(x: FloatArray, t: FloatArray) -> FloatArray:
    """Return the velocity (N,) of an input: slopes of straight lines through as many samples as that needs.

    The variance of a slope through n samples is 12 s^2 / (n^3 h^2), the noise s that of second differences.
    """
    step, count = float(np.median(np.diff(t))), len(x)
    noise = float(np.sqrt(np.mean(np.diff(x, 2) ** 2) / 6.0))
    speed = float(np.sqrt(np.mean((np.diff(x) / np.diff(t)) ** 2)))
    needed = (12.0 * noise**2 / (step * _SLOPE_NOISE * speed) ** 2) ** (1.0 / 3.0) if speed else 1.0
    half = int(np.clip(math.ceil(0.5 * (needed - 1.0)), 1, max(1, count // 200)))
    low = np.clip(np.arange(count) - half, 0, None)
    high = np.clip(np.arange(count) + half + 1, None, count)
    centred = t - t.mean(), x - x.mean()
    sums = [
        np.concatenate([[0.0], np.cumsum(part)])
        for part in (np.ones(count), *centred, centred[0] ** 2, centred[0] * centred[1])
    ]
    number, times, places, squares, products = (part[high] - part[low] for part in sums)
    return np.asarray((number * products - times * places) / (number * squares - times**2))


def build_path(x: FloatArray, t: FloatArray | None, start: joint_models.Start = "zero") -> ElementPath:
    """Return the path of an input (N,), at times (N,) in s; without them one sample takes one second."""
    time = np.arange(len(x), dtype=np.float64) if t is None else t
    return ElementPath(
        position=x, velocity=compute_velocity(x, time), period=_measure_steps(time), start=start
    )


def _prepare(x: FloatArray, y: FloatArray, t: FloatArray | None) -> ElementData:
    """Return a recording with what the element remembered first: that which explains the beginning best."""
    # By stops or relays of any sign, whichever explain the whole better. The beginning lasts until the input
    # has covered half its range: then most of the memory is another one. It is skipped where no start
    # explains it as the rest is explained.
    check_recording(x, y, t)
    data = ElementData(path=build_path(x, t), output=y, kept=np.ones(len(y), dtype=bool))
    thinned = data.thin(_SEARCHED)
    x = thinned.path.position
    rows = np.maximum.accumulate(x) - np.minimum.accumulate(x) <= thinned.path.reach
    low, step = float(x.min()), 2.0 * thinned.path.reach / _COARSE
    tried = [replace(thinned, path=replace(thinned.path, start=start)) for start in _STARTS]
    errors: list[list[FloatArray]] = []
    for family in (Stops(count=_DENSE), RelayGrid(count=_COARSE, low=low, step=step)):
        shape, found = family.list_starts(thinned.path)[0], list[FloatArray]()
        for one in tried:
            matrix = _build_matrix(family, one, shape, ())
            found.append(one.counted - matrix @ _solve(family, matrix, one.counted, (shape, (), False)))
        errors.append(found)
    chosen = min(errors, key=lambda found: min(float(error @ error) for error in found))
    costs = [float(error[rows] @ error[rows]) for error in chosen]
    # The plainest start counts unless another one explains much more.
    best = int(np.argmin(costs))
    best = 0 if costs[0] <= _PLAIN * costs[best] else best
    begun = np.count_nonzero(rows)
    rest = chosen[best][~rows]
    strange = begun < _LONGEST * len(x) and len(rest) and costs[best] / begun > _STRANGE * np.mean(rest**2)
    skipped = round(begun * len(data.output) / len(x)) if strange else 0
    kept = np.arange(len(data.output)) >= skipped
    return replace(data, path=replace(data.path, start=_STARTS[best]), kept=kept)


_MORE, _MOST_STARTS = 0.9, 2
_DENSE, _COARSE, _PLAIN = 20, 8, 1.2
_LONGEST, _STRANGE = 0.25, 3.0
"""Largest share of a beginning that is skipped, and its mean square of the errors over that of the rest."""
Parts = tuple[str, ...]
_PARTS: tuple[Parts, ...] = ((), ("viscous",), ("cubic",), ("viscous", "cubic"))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _ElementTrial:
    """A model at its best shape.

    Args:
        model, form: its name, and what it has beside.
        point: (p,) what the data decide; rebuild: from there to the element.
        jacobian: (N, p) derivatives of the output; error: (N,) output less prediction.
        held: (k, p) rows that hold the point, whose squares count as those of errors do; (0, p) for none.
        refit: errors (n,) of samples of a mask (N,), from a search without them; None where a step of least
            squares says the same.
        wide: mean square of the errors of the widest strokes, left out; None where not measured.
        family, shape: what it is of, where further parts may be added; None where they may not.
    """

    model: str
    form: str
    point: FloatArray
    rebuild: Callable[[FloatArray], joint_models.Elasticity]
    jacobian: FloatArray
    error: FloatArray
    held: FloatArray
    refit: Callable[[NDArray[np.bool_]], FloatArray] | None = None
    wide: float | None = None
    family: ElementFamily | None = None
    shape: FloatArray | None = None

    @property
    def elasticity(self) -> joint_models.Elasticity:
        """Return the element."""
        return self.rebuild(self.point)

    def scale(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the lengths (p,) of the columns, derivatives and held rows over them."""
        lengths = np.linalg.norm(self.jacobian, axis=0)
        lengths = np.where(lengths > 0.0, lengths, 1.0)
        return lengths, self.jacobian / lengths, self.held / lengths


def _build_matrix(family: ElementFamily, data: ElementData, shape: FloatArray, parts: Parts) -> FloatArray:
    """Return the columns of a family, then those of its parts, then a constant, at the samples fitted."""
    path = data.path
    further = {"viscous": path.velocity, "cubic": path.position**3, "offset": np.ones_like(path.position)}
    names = (*parts, *["offset"] * family.has_offset)
    columns = [family.compute_columns(path, shape), *(further[name][:, None] for name in names)]
    return np.hstack(columns)[data.kept]


def _solve(
    family: ElementFamily, matrix: FloatArray, output: FloatArray, setting: tuple[FloatArray, Parts, bool]
) -> FloatArray:
    """Return the coefficients (m,) of least squares within the bounds of the family and its parts."""
    shape, parts, passive = setting
    extra = len(parts) + family.has_offset
    low, high = family.list_limits(shape, matrix.shape[1] - extra, passive=passive)
    least = [0.0 if passive else -np.inf] * len(parts) + [-np.inf] * family.has_offset
    low, high = np.append(low, least), np.append(high, np.full(extra, np.inf))
    lengths = np.linalg.norm(matrix, axis=0)
    lengths = np.where(lengths > 0.0, lengths, 1.0)
    held = np.sqrt(len(matrix)) * family.list_penalties(matrix.shape[1]) / lengths
    # A hair of ridge keeps columns that are nearly alike apart.
    rows = np.vstack([matrix / lengths, np.sqrt(_RIDGE) * np.eye(len(lengths)), held])
    triangle = compute_triangle(np.column_stack([rows, np.append(output, np.zeros(len(rows) - len(output)))]))
    square, right = triangle[: len(lengths), :-1], triangle[: len(lengths), -1]
    if np.all(np.isinf(low)) and np.all(np.isinf(high)):
        return np.asarray(np.linalg.lstsq(square, right, rcond=None)[0] / lengths)
    bounds = low * lengths, high * lengths
    return np.asarray(scipy.optimize.lsq_linear(square, right, bounds, method="bvls").x / lengths)


_RIDGE = 1e-9


def _search(
    family: ElementFamily,
    data: ElementData,
    parts: Parts,
    *,
    passive: bool,
    begin: FloatArray | None = None,
    kept: NDArray[np.bool_] | None = None,
) -> FloatArray:
    """Return the shape of least error over the samples kept, from `begin` or the best of several starts."""
    starts = family.list_starts(data.path) if begin is None else [begin]
    if not (family.searched and len(starts[0])):
        return starts[0]

    rows = slice(None) if kept is None else kept
    # Positive values in their logarithm; an asymmetry, which may be negative, as it is.
    positive = np.all(np.array(family.list_starts(data.path)) > 0.0, axis=0)

    def unpack(packed: FloatArray) -> FloatArray:
        return np.where(positive, np.exp(np.clip(packed, -60.0, 60.0)), packed)

    def errors(packed: FloatArray) -> FloatArray:
        shape = unpack(packed)
        matrix, output = _build_matrix(family, data, shape, parts)[rows], data.counted[rows]
        return np.asarray(output - matrix @ _solve(family, matrix, output, (shape, parts, passive)))

    packed = [np.where(positive, np.log(np.where(positive, s, 1.0)), s) for s in starts]
    runs = []
    for start in sorted(packed, key=lambda start: float(np.sum(errors(start) ** 2)))[:_RANKED]:
        bounds = start - 6.0, start + 6.0
        runs.append(
            scipy.optimize.least_squares(errors, start, diff_step=1e-4, max_nfev=_TRIES, bounds=bounds)
        )
    return unpack(min(runs, key=lambda run: float(run.cost)).x)


_TRIES = 12
_RANKED = 2
_DIFFERENCE = 1e-4


def _try(
    family: ElementFamily, data: ElementData, shape: FloatArray, parts: Parts, *, passive: bool
) -> _ElementTrial:
    """Return a model at a shape, with derivatives of what the data decide."""
    matrix = _build_matrix(family, data, shape, parts)
    found = _solve(family, matrix, data.counted, (shape, parts, passive))
    count = matrix.shape[1] - len(parts) - family.has_offset
    low, high = family.list_limits(shape, count, passive=passive)
    free = np.ones(len(found), dtype=bool)
    free[:count] = (found[:count] > low + _HAIR) & (found[:count] < high - _HAIR)
    jacobian, known = [matrix[:, free]], np.count_nonzero(free)
    searched = len(shape) if family.searched else 0
    for k in range(searched):
        step, moved = _DIFFERENCE * (abs(float(shape[k])) or 1.0), shape.copy()
        moved[k] += step
        further = _build_matrix(family, data, moved, parts) @ found
        jacobian.append(((further - matrix @ found) / step)[:, None])

    def rebuild(point: FloatArray) -> joint_models.Elasticity:
        values, own = found.copy(), shape.copy()
        values[free], own[:searched] = point[:known], point[known:]
        names = ["damping" if part == "viscous" else part for part in (*parts, "offset")]
        extra = dict(zip(names, values[count:].tolist(), strict=False))
        return replace(family.build(own, values[:count]), **extra)

    def refit(mask: NDArray[np.bool_]) -> FloatArray:
        own = _search(family, data, parts, passive=passive, begin=shape, kept=~mask)
        columns = _build_matrix(family, data, own, parts)
        values = _solve(family, columns[~mask], data.counted[~mask], (own, parts, passive))
        return np.asarray((data.counted - columns @ values)[mask])

    penalties = np.sqrt(len(matrix)) * family.list_penalties(matrix.shape[1])
    return _ElementTrial(
        model=family.name,
        form=", ".join((*family.describe(), *parts)),
        point=np.concatenate([found[free], shape[:searched]]),
        rebuild=rebuild,
        jacobian=np.hstack(jacobian),
        error=data.counted - matrix @ found,
        held=np.pad(penalties[:, free], ((0, 0), (0, searched))),
        refit=refit,
        family=family,
        shape=shape,
    )


_HAIR = 1e-12


def _fit_family(
    family: ElementFamily, data: ElementData, folds: "_Folds", *, passive: bool, timed: bool
) -> _ElementTrial:
    """Return a family with the parts that predict held-out samples better."""
    shape = _search(family, data, (), passive=passive)
    plain = best = _try(family, data, shape, (), passive=passive)
    chosen: Parts = ()
    for parts in _PARTS[1:]:
        # Only high speeds separate a level that falls with the speed from damping that rises with it.
        if "viscous" in parts and (not timed or family.falling):
            continue
        trial = _try(family, data, shape, parts, passive=passive)
        if folds.is_better(trial, best):
            best, chosen = trial, parts
    plain = folds.measure_wide(plain)
    if chosen and family.searched:
        again = _search(family, data, chosen, passive=passive, begin=shape)
        best = _try(family, data, again, chosen, passive=passive)
    best = folds.measure_wide(best) if chosen else plain
    return best if folds.is_better(best, plain) else plain


def _refine_places(family: NonlinearStops, data: ElementData, *, passive: bool) -> NonlinearStops:
    """Return the slip spring with the places that its force needs: of a fine grid, without useless ones."""
    shape = _search(family, data, (), passive=passive)
    fine = np.linspace(-1.0, 1.0, _FINE)
    matrix = _build_matrix(replace(family, places=tuple(fine.tolist())), data, shape, ())
    triangle = compute_triangle(np.column_stack([matrix, data.counted]))

    def measure(kept: FloatArray) -> float:
        hats = np.stack([np.interp(fine, kept, unit) for unit in np.eye(len(kept))], axis=1)
        square, right = triangle[:, :-1] @ scipy.linalg.block_diag(1.0, hats), triangle[:, -1]
        return float(np.sum((right - square @ np.linalg.lstsq(square, right, rcond=None)[0]) ** 2))

    kept, cost = fine, measure(fine)
    while len(kept) > _FEWEST:
        inner = 1 + np.flatnonzero(kept[1:-1])
        least, place = min((measure(np.delete(kept, k)), k) for k in inner.tolist())
        # Akaike's criterion: a place is worth two units of the log likelihood.
        if least > cost * (1.0 + 2.0 / len(matrix)):
            break
        kept, cost = np.delete(kept, place), least
    return replace(family, places=tuple(kept.tolist()))


_FINE, _FEWEST = 33, 5


def _fit_spring(data: ElementData, *, knees: bool) -> _ElementTrial | None:
    """Return a passive spring with stops and knees where the data put them; None where there is no such."""
    x, output, start = data.path.position, data.counted, data.path.start
    # Virgin at the first sample is fitted as virgin at zero, and tried as it is.
    side = {"below": -1.0, "above": 1.0}.get(start, 0.0)
    ahead = [x[0] + side * 4.0 * data.path.reach, x[0]] if side else []
    torsion: FloatArray = np.concatenate([np.array(ahead, dtype=np.float64), x])
    first = len(ahead) + int(np.argmax(data.kept))
    grid: FloatArray = data.path.reach * np.power(0.7, np.arange(_GRID, 0, -1))
    spring = spring_fit.SpringData(
        torsions=(torsion,), periods=(_PERIOD,), keeps=(slice(first, None, 1),), rate=_SHARP
    )
    spring = spring.rebuild(grid)
    begun = spring.fit_stops(output)
    if knees:
        places = spring_fit.build_knee_grid(
            [joint_models.compute_stop_basis(torsion, grid) @ begun.stiffness], _KNEES
        )
        begun = spring_fit.fit_spring(
            spring, output, replace(begun, knees=places, slopes=np.ones(len(places)))
        )
    elasticity = spring_fit.build_elasticity(spring_fit.refine_spring(spring, output, begun))
    if knees and not elasticity.knees:
        return None
    found = spring_fit.read_weights(elasticity)
    basis = joint_models.compute_stop_basis(torsion, found.thresholds)
    slopes = spring_fit.compute_spring_slopes(
        basis, found, spring_fit.compute_slips(basis, found.thresholds)
    )[first:]
    names = ("stiffness", "slopes", "thresholds", "knees")
    numbers = [getattr(found, name) for name in names]
    ends = np.cumsum([len(part) for part in numbers])[:-1]

    def rebuild(point: FloatArray) -> joint_models.Elasticity:
        return spring_fit.build_elasticity(
            spring_fit.SpringWeights(**dict(zip(names, np.split(point, ends), strict=True)))
        )

    return _ElementTrial(
        model=("modified-" if knees else "") + "prandtl-ishlinskii",
        form="passive, thresholds from the data",
        point=np.concatenate(numbers),
        rebuild=rebuild,
        jacobian=slopes[:, :-1],
        error=output - predict_output(elasticity, data.path)[data.kept],
        held=np.empty((0, slopes.shape[1] - 1)),
        family=None if elasticity.knees else Stops(count=len(found.thresholds), searched=True),
        shape=found.thresholds,
    )


_GRID, _KNEES = 10, 4
_PERIOD, _SHARP = 2e-3, 1e9
"""Of a spring's rows: they pass no filter."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Folds:
    """What is left out in turn: masks of samples, blocks of time, and the widest strokes or None."""

    blocks: tuple[NDArray[np.bool_], ...]
    wide: NDArray[np.bool_] | None

    def measure_wide(self, trial: _ElementTrial) -> _ElementTrial:
        """Return a model with the mean square of its errors at the widest strokes, left out."""
        if self.wide is None:
            return trial
        errors = _leave_out(trial, self.wide)[0] if trial.refit is None else trial.refit(self.wide)
        return replace(trial, wide=float(np.mean(errors**2)))

    def predict(self, trial: _ElementTrial) -> FloatArray:
        """Return the mean squares of the errors of every block and, if measured, of the widest strokes."""
        blocks = [float(np.mean(_leave_out(trial, mask)[0] ** 2)) for mask in self.blocks]
        return np.array(blocks if trial.wide is None else [*blocks, trial.wide])

    def score(self, trial: _ElementTrial) -> float:
        """Return the geometric mean of the mean squares: blocks count by their ratios, not by their size."""
        return float(np.exp(np.mean(np.log(self.predict(trial) + _FLOOR))))

    def is_better(
        self, trial: _ElementTrial, other: _ElementTrial, *, sure: float = 1.0, least: float = 0.0
    ) -> bool:
        """Return whether a model predicts better than another, by more than `sure` standard errors.

        And by more than `least`, of the logarithm of the mean square.
        """
        own, others = self.predict(trial), self.predict(other)
        count = min(len(own), len(others))
        gains = np.log((others[:count] + _FLOOR) / (own[:count] + _FLOOR))
        return float(np.mean(gains)) > max(least, sure * float(np.std(gains, ddof=1)) / math.sqrt(count))


_FLOOR = 1e-300


def _leave_out(trial: _ElementTrial, mask: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    """Return errors (n,) of samples left out, and the point (p,) without them: a step of least squares."""
    if not trial.jacobian.shape[1]:
        return trial.error[mask], trial.point
    lengths, scaled, held = trial.scale()
    kept, out = scaled[~mask], scaled[mask]
    normal = kept.T @ kept + held.T @ held + _RIDGE * np.eye(len(lengths))
    # What is left is not at its optimum where something was held: the step is from there all the same.
    pull = held.T @ (trial.held @ trial.point)
    step = np.linalg.lstsq(normal, kept.T @ trial.error[~mask] - pull, rcond=None)[0]
    return trial.error[mask] - out @ step, trial.point + step / lengths


def _build_folds(data: ElementData) -> _Folds:
    """Return blocks of equal length, and the widest strokes where there are enough narrower ones."""
    x, count = data.path.position[data.kept], len(data.counted)
    edges = np.linspace(0, count, _BLOCKS + 1).astype(int)
    block = np.searchsorted(edges, np.arange(count), side="right") - 1
    widths = np.zeros(count)
    for low, high in find_strokes(x):
        widths[low:high] = np.ptp(x[low:high])
    wide = widths > _WIDE * widths.max()
    enough = 0.2 <= float(np.mean(wide)) <= 0.8
    return _Folds(blocks=tuple(block == number for number in range(_BLOCKS)), wide=wide if enough else None)


def find_strokes(x: FloatArray, share: float = 0.05) -> list[tuple[int, int]]:
    """Return first and last sample, exclusive, of each way of an input (N,) between two reversals.

    A reversal counts where the input then goes back by more than a `share` of its range.
    """
    bounds, extreme, sense = [0], 0, 0.0
    least = share * float(np.ptp(x))
    for k, place in enumerate(x.tolist()):
        ahead = (place - x[extreme]) * sense
        if sense == 0.0:
            if abs(place - x[0]) > least:
                sense, extreme = float(np.sign(place - x[0])), k
        elif ahead > 0.0:
            extreme = k
        elif ahead < -least:
            bounds.append(extreme + 1)
            sense, extreme = -sense, k
    return list(itertools.pairwise([*bounds, len(x)]))


def _list_trials(
    data: ElementData, folds: _Folds, options: HysteresisOptions, *, timed: bool
) -> list[_ElementTrial]:
    """Return every model that is to be tried, passive ones and, unless only these are wanted, free ones."""
    wanted = HYSTERESIS_MODELS if options.model == "auto" else (options.model,)
    trials: list[_ElementTrial | None] = []
    for name in wanted:
        if name == "modified-prandtl-ishlinskii":
            trial = _fit_spring(data, knees=True)
            # Without knees it is the plain model.
            alone = trial is None and options.model == name
            trials.append(_fit_spring(data, knees=False) if alone else trial)
            continue
        if name == "prandtl-ishlinskii":
            trials.append(_fit_spring(data, knees=False))
        for family in list_families(name, data.path, timed=timed):
            form = family
            if isinstance(form, NonlinearStops) and form.count == 1:
                form = _refine_places(form, data, passive=bool(options.passive))
            trials.append(_fit_family(form, data, folds, passive=bool(options.passive), timed=timed))
    found = [
        trial if trial.wide is not None else folds.measure_wide(trial)
        for trial in trials
        if trial is not None
    ]
    if options.passive:
        found = [trial for trial in found if joint_models.is_passive_element(trial.elasticity)]
    if not found:
        kind = "passive element" if options.passive else "element"
        text = f"no {kind} of model {options.model} explains the recording; try passive=None, or model auto"
        raise UsageError(Notice(code="usage.no-hysteresis", text=text))
    return found


def _extend(
    trial: _ElementTrial, data: ElementData, folds: _Folds, *, passive: bool, timed: bool
) -> _ElementTrial | None:
    """Return the model behind a gap, or beside a spring that relaxes, where that predicts surely better."""
    if trial.family is None or trial.shape is None:
        return None
    kinds: list[type[WithBacklash | WithRelaxation]] = [] if passive else [WithBacklash]
    kinds += [WithRelaxation] if timed else []
    # Stops that a passive fit has placed stay springs.
    springs = passive or (
        isinstance(trial.family, Stops) and joint_models.is_passive_element(trial.elasticity)
    )
    begin = tuple(trial.shape.tolist())
    known: list[ElementFamily] = [trial.family]
    while isinstance(known[-1], WithBacklash | WithRelaxation):
        known.append(known[-1].base)
    new = [kind for kind in kinds if not any(isinstance(family, kind) for family in known)]
    families = [kind(base=trial.family, begin=begin) for kind in new]
    found = [_fit_family(family, data, folds, passive=springs, timed=timed) for family in families]
    better = [entry for entry in found if folds.is_better(entry, trial, sure=_CLEARLY)]
    return min(better, key=folds.score, default=None)


_CLEARLY = 2.0
"""Standard errors: two further numbers must not come in by chance."""


def _choose(trials: list[_ElementTrial], folds: _Folds) -> list[_ElementTrial]:
    """Return the models, the chosen one first, then by what they predict."""
    # Within half a standard error of the best models are equal; half as many parameters may cost a whole one.
    ranked = sorted(trials, key=folds.score)
    best = ranked[0]
    equal = [trial for trial in ranked if not folds.is_better(best, trial, sure=0.5)]
    simple = [
        trial
        for trial in ranked
        if 2 * len(trial.point) <= len(best.point) and not folds.is_better(best, trial)
    ]
    chosen = min((*equal, *simple), key=lambda trial: len(trial.point))
    return [chosen, *(trial for trial in ranked if trial is not chosen)]


_RIVAL = 10.0
"""Of the chosen model's mean square; what predicts worse is not tried with further parts."""


def _compute_covariance(trial: _ElementTrial, folds: _Folds) -> FloatArray:
    """Return the covariance (p, p) of a point, for errors alike from sample to sample, and unlike in size."""
    lengths, scaled, held = trial.scale()
    inverse = np.linalg.inv(scaled.T @ scaled + held.T @ held + _RIDGE * np.eye(len(lengths)))
    scores = scaled * trial.error[:, None]
    count = len(scores)
    waves = np.fft.rfft(scores, n=2 * count, axis=0)
    distance = np.arange(2 * count)
    lag = np.minimum(distance, 2 * count - distance) / max(2.0, _LAG * count)
    near, far = 1.0 - 6.0 * lag**2 + 6.0 * lag**3, 2.0 * (1.0 - lag) ** 3
    window = np.fft.rfft(np.where(lag <= 0.5, near, np.where(lag <= 1.0, far, 0.0))).real
    double = np.full(len(window), 2.0)
    double[[0, -1]] = 1.0
    middle = (waves.conj().T * (window * double)) @ waves / (2 * count)
    spectral = inverse @ middle.real @ inverse / np.outer(lengths, lengths)
    points = np.array([_leave_out(trial, mask)[1] for mask in folds.blocks])
    apart = points - points.mean(axis=0)
    jackknife = apart.T @ apart * (len(points) - 1) / len(points)
    return np.asarray(0.5 * (spectral + jackknife))


_LAG = 0.1
"""Of the recording: longest lag at which errors may be alike."""


def fit_hysteresis(
    x: FloatArray, y: FloatArray, t: FloatArray | None = None, options: HysteresisOptions | None = None
) -> HysteresisRecord:
    """Return the element that predicts held-out samples best, with as few parameters as that takes.

    Args:
        x: (N,) input, such as a torsion in rad.
        y: (N,) output, such as a torque in N m.
        t: (N,) time, s, increasing; None: only models that follow the path are tried.
        options: the model wanted, and whether it must be passive.

    Raises:
        UsageError: no recording, or no passive element of the model explains it.
    """
    options = options or HysteresisOptions()
    x, y = (np.asarray(part, dtype=np.float64) for part in (x, y))
    t = None if t is None else np.asarray(t, dtype=np.float64)
    whole = _prepare(x, y, t)
    timed, passive = t is not None, bool(options.passive)
    tried: list[joint_models.Start] = []
    while True:
        tried.append(whole.path.start)
        data = whole.thin(_SEARCHED)
        folds = _build_folds(data)
        ranked = _choose(_list_trials(data, folds, options, timed=timed), folds)
        # The further parts that the chosen model turns out to need.
        while further := _extend(ranked[0], data, folds, passive=passive, timed=timed):
            # They may make another model the better one, too.
            others = {trial.model: trial for trial in reversed(ranked) if trial.model != ranked[0].model}
            limit = _RIVAL * folds.score(ranked[0])
            rivals = [trial for trial in others.values() if folds.score(trial) < limit]
            added = [_extend(trial, data, folds, passive=passive, timed=timed) for trial in rivals]
            more = [further, *(trial for trial in added if trial is not None)]
            ranked = _choose([*more, *ranked], folds)
            if not any(ranked[0] is trial for trial in more):
                break
        # Perhaps the element that was found explains more with another start.
        starts = (whole.path.start, *(start for start in _STARTS if start not in tried))
        costs = []
        for start in starts:
            left = data.output - predict_output(ranked[0].elasticity, replace(data.path, start=start))
            costs.append(float(np.var(left[data.kept])))
        best = int(np.argmin(costs))
        if not best or len(tried) >= _MOST_STARTS or not costs[best] < _MORE * costs[0]:
            break
        whole = replace(whole, path=replace(whole.path, start=starts[best]))
    chosen = ranked[0]
    spread, scale = float(np.std(whole.counted)), float(np.std(data.counted))
    candidates = []
    for trial in ranked:
        blocks, score = folds.predict(trial), math.sqrt(folds.score(trial))
        error = float(np.std(blocks, ddof=1)) / math.sqrt(len(blocks))
        candidates.append(
            HysteresisCandidate(
                model=trial.model,
                form=trial.form,
                count=len(trial.point),
                passive=joint_models.is_passive_element(trial.elasticity),
                fitted=100.0 * float(np.sqrt(np.mean(trial.error**2))) / scale,
                held_out=100.0 * score / scale,
                spread=100.0 * 0.5 * error / max(score, 1e-300) / scale,
            )
        )
    elasticity = chosen.elasticity
    predicted = predict_output(elasticity, whole.path)
    every = slice(None, None, max(1, len(predicted) // _SHOWN))
    # The numbers of the element, and how they follow what the data decide.
    centre, covariance = joint_models.list_element_values(elasticity), _compute_covariance(chosen, folds)
    rates = np.zeros((len(centre), len(chosen.point)))
    for k, number in enumerate(chosen.point):
        step, moved = 1e-6 * (abs(float(number)) or 1.0), chosen.point.copy()
        moved[k] += step
        after = joint_models.list_element_values(chosen.rebuild(moved))
        rates[:, k] = [(after.get(name, value) - value) / step for name, value in centre.items()]
    deviations = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", rates, covariance, rates), 0.0))
    return HysteresisRecord(
        model=chosen.model,
        form=chosen.form,
        elasticity=elasticity,
        start=whole.path.start,
        parameters=tuple(
            ElementParameter(name=name, value=value, deviation=float(deviation))
            for (name, value), deviation in zip(centre.items(), deviations, strict=True)
        ),
        candidates=tuple(candidates),
        passive=joint_models.is_passive_element(elasticity),
        fitted=100.0 * float(np.sqrt(np.mean((y - predicted)[whole.kept] ** 2))) / spread,
        held_out=candidates[0].held_out,
        samples=len(x),
        skipped=int(np.count_nonzero(~whole.kept)),
        span=(float(x.min()), float(x.max())),
        speed=float(np.max(np.abs(whole.path.velocity))),
        output=spread,
        timed=timed,
        trace=ElementTrace(
            time=(np.cumsum(whole.path.period) - whole.path.period[0])[every],
            position=whole.path.position[every],
            measured=whole.output[every],
            predicted=predicted[every],
        ),
    )


_SHOWN = 3000


def predict_element(
    record: HysteresisRecord, x: FloatArray, t: FloatArray | None = None, *, start: str | None = None
) -> FloatArray:
    """Return the output (N,) of an element for an input (N,), at times (N,) in s where it needs them.

    `start`: what it remembers first (`Start`); None: as in the recording of the fit.

    Raises:
        UsageError: no time where the element needs it, or an unknown start.
    """
    _check_time(record, t)
    begun = next((known for known in _STARTS if known == (start or record.start)), None)
    if begun is None:
        text = f"unknown start {start!r}. Known: {', '.join(_STARTS)}"
        raise UsageError(Notice(code="usage.unknown-start", text=text))
    return predict_output(record.elasticity, build_path(x, t, begun))


def describe_inversion(record: HysteresisRecord) -> str:
    """Return why an element that was identified has no inverse to rely on; empty where it has one."""
    reason = joint_models.describe_inverse(record.elasticity)
    slope = next((entry for entry in record.parameters if entry.name == "k0"), None)
    if reason or slope is None or slope.value > _SURE * slope.deviation:
        return reason
    return (
        f"k0 = {slope.value:.3g} +- {slope.deviation:.2g} cannot be told from zero: large outputs may need "
        "any input, or have none"
    )


_SURE = 3.0


def invert_fit(
    record: HysteresisRecord, y: FloatArray, t: FloatArray | None = None, *, beyond: bool = False
) -> FloatArray:
    """Return the input (N,) at which an element has an output (N,), at times (N,) in s where needed.

    Raises:
        UsageError: the element has no inverse, or the input would leave that of the fit by more than half its
            range and `beyond` is False.
    """
    reason = describe_inversion(record)
    if reason:
        raise UsageError(Notice(code="usage.no-inverse", text=f"the element has no inverse: {reason}"))
    _check_time(record, t)
    x = joint_models.invert_element(record.elasticity, y, t, start=record.start)
    low, high = record.span
    slack = _FAR * (high - low)
    if not beyond and len(x) and not (low - slack <= x.min() and x.max() <= high + slack):
        text = (
            f"these outputs need inputs from {x.min():.4g} to {x.max():.4g}; the fit saw {low:.4g} to "
            f"{high:.4g}. Ask for smaller outputs, or fit a recording that reaches so far (beyond=True goes "
            "there all the same)"
        )
        raise UsageError(Notice(code="usage.inverse-beyond", text=text))
    return x


_FAR = 0.5


def _check_time(record: HysteresisRecord, t: FloatArray | None) -> None:
    if t is None and joint_models.needs_time(record.elasticity):
        text = "this element depends on the speed: give the time of the samples, too"
        raise UsageError(Notice(code="usage.hysteresis-time", text=text))


def predict_output(elasticity: joint_models.Elasticity, path: ElementPath) -> FloatArray:
    """Return the output (N,) of an element along a path."""
    if path.begins[1:]:
        return np.concatenate([predict_output(elasticity, part) for part in path.split()])
    time = np.cumsum(path.period)
    run = joint_models.run_element(
        elasticity, path.position, time, start=path.start, velocity=path.velocity, runner=run_compiled_branch
    )
    return run.output


def choose_spring(
    path: ElementPath, output: FloatArray, kept: NDArray[np.bool_], known: joint_models.Elasticity
) -> tuple[joint_models.Elasticity, str, float, float]:
    """Return the spring of a joint that predicts its torque best with as few numbers as that takes.

    A linear one, Bouc-Wen elements, stops without knees, all passive and with viscous or cubic parts where
    these help, and `known`, whose errors are those of its fit; it is left only for what is surely better, or
    for the linear one where nothing is.

    Args:
        path: torsion (N,), rad or m.
        output: (N,) N m or N.
        kept: (N,) samples that count.
        known: a spring that was fitted to the same.

    Returns:
        the spring; its name, "" for `known`; what it and `known` leave of the output, percent.
    """
    whole = ElementData(path=path, output=output, kept=kept)
    data = whole.thin(_SEARCHED, turns=True)
    folds = _build_folds(data)
    families: tuple[ElementFamily, ...] = (
        Stops(count=0, name="linear"),
        BoucWenFamily(),
        BoucWenFamily(asymmetric=True),
        Stops(count=16, ratio=0.8, name="stops"),
    )
    trials = [_fit_family(family, data, folds, passive=True, timed=True) for family in families]
    # Along all samples: a thin path misses small reversals.
    predicted = replace(whole, output=predict_output(known, path)).thin(_SEARCHED, turns=True).counted
    own = _ElementTrial(
        model="",
        form="",
        point=np.zeros(2),
        rebuild=lambda _: known,
        # It was fitted to another torque, of nearly the same scale and zero.
        jacobian=np.column_stack([predicted, np.ones_like(predicted)]),
        error=data.counted - predicted,
        held=np.empty((0, 2)),
    )
    best = min(trials, key=folds.score)
    chosen = best if folds.is_better(best, own, least=_SURELY) else own
    if not folds.is_better(chosen, trials[0], least=_PLAINLY if chosen is own else _SURELY):
        chosen = trials[0]
    spread = float(np.std(data.counted))
    left = [100.0 * math.sqrt(folds.score(trial)) / spread for trial in (chosen, own)]
    parts = [word for word in ("viscous", "cubic") if word in chosen.form]
    name = ", ".join((chosen.model, *parts)) if chosen.model else ""
    # Encoders are brought into line by what gravity does, which leaves some of their offset.
    return replace(chosen.elasticity, offset=0.0), name, left[0], left[1]


_SURELY, _PLAINLY = 0.7, 0.35
"""Of the logarithm of a mean square: three tenths of the error, below which a spring is called nothing but
linear, or stops and knees; half of that for stops and knees instead of a linear one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HysteresisTrial:
    """What an element predicts of a recording that it was not fitted to.

    Args:
        error: rms of the error over rms of the output, both about their means, percent.
        shift: mean of the error, N m or N: sensors may have other zeros.
        beyond: share of samples whose input is outside that of the fit; samples: number; skipped: of them, at
            the beginning, that do not count, since the memory there is not known.
        inverse: rms of the input that the inverse finds for the output less that of the recording, over the
            rms of the latter, both about their means, percent; None where there is no inverse.
    """

    error: float
    shift: float
    beyond: float
    samples: int
    skipped: int
    inverse: float | None


def validate_element(
    record: HysteresisRecord, x: FloatArray, y: FloatArray, t: FloatArray | None = None
) -> HysteresisTrial:
    """Return what an element predicts of another recording, arguments as of `fit_hysteresis`.

    Raises:
        UsageError: no recording, or no time where the element needs it.
    """
    x, y = (np.asarray(part, dtype=np.float64) for part in (x, y))
    t = None if t is None else np.asarray(t, dtype=np.float64)
    _check_time(record, t)
    data = _prepare(x, y, t)
    error = (y - predict_output(record.elasticity, data.path))[data.kept]
    low, high = record.span
    slack = _SLACK * (high - low)
    inverse = None
    if not describe_inversion(record):
        # How far the inputs are that give the measured outputs.
        thin = data.thin(_INVERTED)
        time, shifted = np.cumsum(thin.path.period), thin.output - float(np.mean(error))
        found = joint_models.invert_element(record.elasticity, shifted, time, start=thin.path.start)
        counted = thin.path.position[thin.kept]
        inverse = 100.0 * float(np.std(found[thin.kept] - counted) / np.std(counted))
    return HysteresisTrial(
        error=100.0 * float(np.std(error)) / float(np.std(data.counted)),
        shift=float(np.mean(error)),
        beyond=float(np.mean((x < low - slack) | (x > high + slack))),
        samples=len(x),
        skipped=int(np.count_nonzero(~data.kept)),
        inverse=inverse,
    )


_INVERTED = 1500
_SLACK = 0.01
"""Of the range of the input; what is beyond it by less is no extrapolation."""
