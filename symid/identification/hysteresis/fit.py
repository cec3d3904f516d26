"""A bare element from its input and output: shapes searched, parts and model chosen by held-out prediction.

x, y, t -> `HysteresisRecord`.

    search      min |y - Phi(s) c| over shape values s, coefficients c eliminated, bounded where passive
                (variable projection, Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973) 413-432)
    held out    p_(-b) = p - step of least squares without parts b, from derivatives at p; r = y - y(p_(-b));
                parts are of equal ways of the input, every sixth of them is left out in turn
    choice      least sum of squares held out; of the models that `judge.compare` does not call worse, the one
                of fewest parameters. So are starts, parts, places and springs chosen
    deviations  jackknife over the parts

Supported: uneven samples; a start from rest or either side; one recording, several for springs of joints.
Not supported: outputs noisier than they are large.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import scipy
from numpy.typing import NDArray

from symid import joint_models
from symid.arrays import FloatArray, FrozenArrays, compute_triangle
from symid.codegen import run_compiled_branch
from symid.errors import Notice, UsageError
from symid.identification.hysteresis import families, spring_fit
from symid.identification.hysteresis.families import EXACT, GRID, SAMPLES, STARTS, ElementForm, ElementPath
from symid.identification.judge import POLICY, compare, compute_changes, numerics
from symid.ipopt import keep_last
from symid.notation import HYSTERESIS_MODELS
from symid.options import HysteresisOptions
from symid.serialization import HIDDEN

_STARTS: tuple[joint_models.Start, ...] = ("zero", "fresh", "below", "above")
_PARTS = POLICY.folds * POLICY.parts
"""Parts of a recording."""
_FAR = 0.5
"""Of the range of the input of a fit, how far an inverse may lead beyond it."""


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
        fitted: rms of the error over rms of the output, both about their means, percent, of all samples;
            held_out: of samples left out; spread: standard error of the latter.
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
        last_quarter: the same of the last quarter of the input's way, predicted by a fit to the rest; 0 where
            it is not known.
        samples: number; skipped: of them, at the beginning, not fitted; span: least and largest input; speed:
            the largest; output: rms about its mean.
        timed: whether the time of the samples was known.
        names, units: of input and output, as the recording has them; units are "" where it states none.
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
    last_quarter: float = 0.0
    samples: int
    skipped: int
    span: tuple[float, float]
    speed: float
    output: float
    timed: bool
    names: tuple[str, str] = ("input", "output")
    units: tuple[str, str] = ("", "")
    trace: ElementTrace = field(metadata=HIDDEN)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElementData:
    """A recording as the fit uses it: path and output (N,), thinned.

    Samples `kept` (N,) are fitted; the others, whose memory is not known, are only followed.
    """

    path: ElementPath
    output: FloatArray
    kept: NDArray[np.bool_]

    @property
    def counted(self) -> FloatArray:
        """Return the output (M,) of the samples that are fitted."""
        return self.output[self.kept]

    def list_thin(self, most: int) -> NDArray[np.intp]:
        """Return about `most` of the samples, at even places, and as many at most where x turns."""
        every, path = max(1, len(self.output) // most), self.path
        if every == 1:
            return np.arange(len(self.output))
        taken = np.zeros(len(self.output), dtype=bool)
        taken[::every] = taken[list(path.begins)] = True
        share = POLICY.relevance
        while len(strokes := find_strokes(path.position, share)) > most:
            # Noise turns as well: only what stands out of it counts.
            share *= 2.0
        taken[[low - 1 for low, _ in strokes[1:]]] = True
        return np.flatnonzero(taken)

    def thin(self, most: int) -> "ElementData":
        """Return the data at these samples."""
        if len(index := self.list_thin(most)) == len(self.output):
            return self
        path = self.path
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


def check_recording(x: FloatArray, y: FloatArray, t: FloatArray | None) -> None:
    """Raise a UsageError, with all that is wrong, for what is no recording of an element."""
    mistakes = []
    if x.ndim != 1 or x.shape != y.shape or (t is not None and t.shape != x.shape):
        shapes = ", ".join(str(part.shape) for part in (x, y, *(() if t is None else (t,))))
        mistakes.append(f"input, output and time must be columns of one length, got {shapes}")
    elif len(x) < 2 * _PARTS:
        mistakes.append(f"{len(x)} samples; at least {2 * _PARTS} are needed")
    for name, part in (("input", x), ("output", y), ("time", t)):
        if part is not None and not np.all(np.isfinite(part)):
            place = int(np.flatnonzero(~np.isfinite(part.ravel()))[0])
            mistakes.append(f"{name}: sample {place + 1} is not a finite number; leave such rows out")
        elif part is not None and name != "time" and part.size and not np.ptp(part) > 0.0:
            mistakes.append(f"{name}: all samples are {float(part.flat[0]):g}; it must move")
    if t is not None and t.ndim == 1 and np.all(np.isfinite(t)) and np.any(np.diff(t) <= 0.0):
        place = int(np.flatnonzero(np.diff(t) <= 0.0)[0])
        mistakes.append(f"time: sample {place + 2} is not later than the one before it")
    UsageError.refuse(mistakes, code="usage.hysteresis-recording")


def compute_velocity(x: FloatArray, t: FloatArray) -> FloatArray:
    """Return the velocity (N,) of an input: slopes of straight lines through as many samples as that needs.

    The variance of a slope through n samples is 12 s^2 / (n^3 h^2), the noise s that of second differences.
    """
    step, count = float(np.median(np.diff(t))), len(x)
    noise = float(np.sqrt(np.mean(np.diff(x, 2) ** 2) / 6.0))
    speed = float(np.sqrt(np.mean((np.diff(x) / np.diff(t)) ** 2)))
    needed = (12.0 * noise**2 / (step * POLICY.relevance * speed) ** 2) ** (1.0 / 3.0) if speed else 1.0
    half = int(np.clip(math.ceil(0.5 * (needed - 1.0)), 1, max(1, count // 200)))
    places = np.arange(count)
    low, high = np.clip(places - half, 0, None), np.clip(places + half + 1, None, count)
    t, x = t - t.mean(), x - x.mean()
    sums = (np.append(0.0, np.cumsum(part)) for part in (np.ones(count), t, x, t**2, t * x))
    number, times, ways, squares, products = (part[high] - part[low] for part in sums)
    return np.asarray((number * products - times * ways) / (number * squares - times**2))


def build_path(x: FloatArray, t: FloatArray | None, start: joint_models.Start = "zero") -> ElementPath:
    """Return the path of an input (N,), at times (N,) in s; without them one sample takes one second."""
    time = np.arange(len(x), dtype=np.float64) if t is None else t
    steps = _measure_steps(time)
    return ElementPath(position=x, velocity=compute_velocity(x, time), period=steps, start=start)


def _prepare(x: FloatArray, y: FloatArray, t: FloatArray | None) -> ElementData:
    """Return a recording with what the element remembered first, by stops and a curve."""
    check_recording(x, y, t)
    whole = ElementData(path=build_path(x, t), output=y, kept=np.ones(len(y), dtype=bool))
    data, stops, errors = (whole.thin(SAMPLES), families.Stops(count=GRID), list[FloatArray]())
    x = data.path.position
    curve = np.clip((x[:, None] - x.min()) * GRID / np.ptp(x) - np.arange(GRID), 0.0, 1.0)
    for start in _STARTS:
        path = replace(data.path, start=start)
        columns = stops.compute_columns(path, stops.list_starts(path)[0])
        matrix = np.column_stack([columns, curve, np.ones(len(x))])
        errors.append(data.output - matrix @ np.linalg.lstsq(matrix, data.output, numerics.RANK)[0])
    begun = _find_beginning(x)
    start = _choose_start(x[begun], data.output[begun], [error[begun] for error in errors])
    return replace(whole, path=replace(whole.path, start=start))


def _find_beginning(x: FloatArray) -> NDArray[np.bool_]:
    """Return the samples (N,) until the input has covered half its range, and with it most of the memory."""
    return np.asarray(np.maximum.accumulate(x) - np.minimum.accumulate(x) <= 0.5 * np.ptp(x))


def _choose_start(x: FloatArray, y: FloatArray, errors: Sequence[FloatArray]) -> joint_models.Start:
    """Return the plainest start whose errors (N,) are not worse than those of the best."""
    losses = [_measure(_cut(x), error, y) for error in errors]
    best = min(losses, key=lambda loss: float(loss.sum()))
    return next(start for start, loss in zip(_STARTS, losses, strict=True) if not _is_better(loss, best))


def _find_memory(elasticity: joint_models.Elasticity, data: ElementData) -> ElementData:
    """Return a recording with the start with which an element explains it.

    The beginning does not count where it is short and no start explains it as the rest is explained.
    """
    paths, begun = [replace(data.path, start=start) for start in _STARTS], _find_beginning(data.path.position)
    errors = [data.output - predict_output(elasticity, path) for path in paths]
    # Sensors may have other zeros.
    errors = [error - np.mean(error[~begun]) for error in errors]
    start = _choose_start(data.path.position, data.output, errors)
    squares = errors[_STARTS.index(start)] ** 2
    short = np.max(_cut(data.path.position)[begun]) < POLICY.parts
    strange = short and np.mean(squares[begun]) > POLICY.fall * np.mean(squares[~begun])
    return replace(data, path=replace(data.path, start=start), kept=~begun | (not strange))


def _cut(x: FloatArray) -> NDArray[np.intp]:
    """Return the part of every sample (N,), of equal ways of the input: at rest nothing is learnt."""
    ways = np.cumsum(np.abs(np.diff(x, prepend=x[:1])))
    return np.minimum(ways * _PARTS / max(float(ways[-1]), numerics.TINY), _PARTS - 1).astype(np.intp)


def _measure(part: NDArray[np.intp], errors: FloatArray, output: FloatArray) -> FloatArray:
    """Return the losses (parts, 1): squares of errors (N,) in each part, over those of the output in all."""
    sums = np.bincount(part, errors**2, minlength=_PARTS)
    return sums[:, None] / max(float(np.var(output)) * len(output), numerics.TINY)


def _is_better(before: FloatArray, after: FloatArray) -> bool:
    """Return whether losses (parts, 1) are surely less than others, by more than matters."""
    floor = EXACT**2 / len(before)
    found = compare(before + floor, after + floor)
    sure = found.p_of_all < POLICY.caution and found.fall_of_all > 1.0 + POLICY.relevance
    # Few parts may have all of what a model lacks: those with a reversal.
    return sure or found.fall_of_all > POLICY.fall


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Optimum:
    """A model around its best point (p,): derivatives of the output (M, p), output less prediction (M,).

    The squares of rows `held` (k, p) times the point count as those of errors do.
    """

    point: FloatArray
    jacobian: FloatArray
    error: FloatArray
    held: FloatArray

    def leave_out(self, mask: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
        """Return errors (n,) of samples left out, and the point (p,) without them, by least squares."""
        lengths = np.linalg.norm(self.jacobian, axis=0)
        lengths = np.where(lengths > 0.0, lengths, 1.0)
        held, kept = self.held / lengths, self.jacobian[~mask] / lengths
        normal = kept.T @ kept + held.T @ held + numerics.RIDGE * np.eye(len(lengths))
        # What is left is not at its optimum where something was held: the step is from there all the same.
        right = kept.T @ self.error[~mask] - held.T @ (self.held @ self.point)
        step = np.linalg.lstsq(normal, right, rcond=None)[0] / lengths
        return self.error[mask] - self.jacobian[mask] @ step, self.point + step

    def measure(self, task: "_Task") -> FloatArray:
        """Return the losses (parts, 1) of errors left out."""
        part = task.part
        errors = np.zeros(len(part))
        for fold in range(POLICY.folds):
            mask = part % POLICY.folds == fold
            errors[mask] = self.leave_out(mask)[0]
        return _measure(part, errors, task.data.counted)


@dataclass(frozen=True, slots=True, eq=False)
class _ElementTrial:
    """A model at its best shape: `rebuild` leads from a point to the element, `losses` are (parts, 1).

    `refit` leads from another task to the same model; `source` is None where no parts may be added to it.
    """

    model: str
    form: str
    optimum: _Optimum
    rebuild: Callable[[FloatArray], joint_models.Elasticity]
    losses: FloatArray
    refit: "Callable[[_Task], _ElementTrial]"
    source: ElementForm | None
    shape: FloatArray

    @property
    def elasticity(self) -> joint_models.Elasticity:
        """Return the element."""
        return self.rebuild(self.optimum.point)

    @property
    def score(self) -> float:
        """Return the sum of its losses."""
        return float(self.losses.sum())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Task:
    """What models are fitted to; `timed`: the time of samples is known.

    Searches end after so many `rounds` of every start, but for the best, or where squares fall by less.
    """

    data: ElementData
    passive: bool
    timed: bool
    tolerance: float = numerics.CONVERGED
    rounds: int = numerics.ROUNDS

    @property
    def part(self) -> NDArray[np.intp]:
        """Return for every sample that is fitted (M,) its part of the recording."""
        return _cut(self.data.path.position[self.data.kept])


def _fit_linear(
    form: ElementForm, data: ElementData, shape: FloatArray, *, passive: bool
) -> tuple[FloatArray, FloatArray]:
    """Return the columns (M, m) at the samples fitted, and their coefficients (m,) within their bounds."""
    matrix, output = form.compute_columns(data.path, shape)[data.kept], data.counted
    low, high = form.list_limits(matrix.shape[1], passive=passive)
    lengths = np.linalg.norm(matrix, axis=0)
    lengths = np.where(lengths > 0.0, lengths, 1.0)
    held = np.sqrt(len(matrix)) * form.family.list_penalties(matrix.shape[1]) / lengths
    # A hair of ridge keeps columns that are nearly alike apart.
    rows = np.vstack([matrix / lengths, np.sqrt(numerics.RIDGE) * np.eye(len(lengths)), held])
    triangle = compute_triangle(np.column_stack([rows, np.append(output, np.zeros(len(rows) - len(output)))]))
    square, right = triangle[: len(lengths), :-1], triangle[: len(lengths), -1]
    if np.all(np.isinf(low)) and np.all(np.isinf(high)):
        return matrix, np.asarray(np.linalg.lstsq(square, right, rcond=None)[0] / lengths)
    bounds = low * lengths, high * lengths
    return matrix, np.asarray(scipy.optimize.lsq_linear(square, right, bounds, method="bvls").x / lengths)


def _compute_errors(form: ElementForm, task: _Task, shape: FloatArray) -> FloatArray:
    """Return the errors (M,) of the best coefficients at a shape."""
    matrix, found = _fit_linear(form, task.data, shape, passive=task.passive)
    return np.asarray(task.data.counted - matrix @ found)


def _search(form: ElementForm, task: _Task, starts: Sequence[FloatArray]) -> FloatArray:
    """Return the shape of least error, from the best of several starts."""
    count = form.count_searched(starts[0])
    if not count:
        return starts[0]

    def search(start: FloatArray, rounds: int) -> tuple[float, FloatArray]:
        def errors(moves: FloatArray) -> FloatArray:
            return _compute_errors(form, task, form.move(start, moves))

        def slopes(moves: FloatArray) -> FloatArray:
            here, steps = known(moves), numerics.CONVERGED * np.eye(count)
            return np.stack([errors(moves + step) - here for step in steps], axis=1) / numerics.CONVERGED

        known, far, least = keep_last(errors), -math.log(POLICY.relevance), task.tolerance
        run = scipy.optimize.least_squares(
            known, np.zeros(count), slopes, (-far, far), ftol=least, xtol=least, max_nfev=rounds
        )
        return float(run.cost), form.move(start, run.x)

    ranked = sorted(starts, key=lambda start: float(np.sum(_compute_errors(form, task, start) ** 2)))
    runs = [search(start, task.rounds if starts[1:] else numerics.ROUNDS) for start in ranked[:STARTS]]
    best = min(runs, key=lambda run: run[0])[1]
    return search(best, numerics.ROUNDS)[1] if starts[1:] and task.rounds < numerics.ROUNDS else best


def _try(form: ElementForm, task: _Task, shape: FloatArray) -> _ElementTrial:
    """Return a model at a shape, with derivatives of what the data decide."""
    data = task.data
    matrix, found = _fit_linear(form, data, shape, passive=task.passive)
    low, high = form.list_limits(len(found), passive=task.passive)
    # What moves the output by no more than a search leaves open is at its bound, zero.
    lengths = np.maximum(np.linalg.norm(matrix, axis=0), numerics.TINY)
    effects = np.minimum(found - low, high - found) * lengths
    free = effects > numerics.CONVERGED * np.linalg.norm(data.counted)
    found = np.where(free, found, 0.0)
    jacobian, known, count = [matrix[:, free]], np.count_nonzero(free), form.count_searched(shape)
    for step in numerics.CONVERGED * np.eye(count):
        further = form.compute_columns(data.path, form.move(shape, step))[data.kept] - matrix
        jacobian.append((further @ found / numerics.CONVERGED)[:, None])

    def rebuild(point: FloatArray) -> joint_models.Elasticity:
        values = found.copy()
        values[free] = point[:known]
        return form.build(form.move(shape, point[known:]), values)

    penalties = np.sqrt(len(matrix)) * form.family.list_penalties(matrix.shape[1])
    point, held = np.append(found[free], np.zeros(count)), np.pad(penalties[:, free], ((0, 0), (0, count)))
    error = data.counted - matrix @ found
    optimum = _Optimum(point=point, jacobian=np.hstack(jacobian), error=error, held=held)

    def refit(task: _Task) -> _ElementTrial:
        return _try(form, task, _search(form, task, [shape]))

    losses, name = optimum.measure(task), form.family.name
    return _ElementTrial(name, form.describe(), optimum, rebuild, losses, refit, form, shape)


def _fit_form(form: ElementForm, task: _Task, starts: Sequence[FloatArray]) -> _ElementTrial:
    """Return a model with the viscous and cubic parts that predict held-out samples better."""
    shape = _search(form, task, starts)
    # Only high speeds separate a level that falls with the speed from damping that rises with it.
    names = ("cubic",) if form.family.falling or not task.timed else ("viscous", "cubic")
    sets = itertools.chain.from_iterable(itertools.combinations(names, count) for count in range(3))
    trials = [_try(replace(form, parts=form.parts + parts), task, shape) for parts in sets]
    chosen = _choose(trials)[0]
    return chosen if chosen is trials[0] else _choose([chosen.refit(task), *trials])[0]


def _refine_places(family: families.NonlinearStops, task: _Task) -> ElementForm:
    """Return slip springs with the places that their force needs: of a fine grid, without useless ones."""
    path, fine = task.data.path, np.linspace(-1.0, 1.0, 2 * len(family.places) - 1)
    shape = _search(ElementForm(family=family), task, family.list_starts(path))
    one, falls = replace(family, places=tuple(fine.tolist()), count=1), shape[family.count :]
    parts = [one.compute_columns(path, np.append(radius, falls))[:, 1:] for radius in shape[: family.count]]
    matrix = np.column_stack([path.position, *parts])[task.data.kept]
    triangle = compute_triangle(np.column_stack([matrix, task.data.counted]))

    def measure(kept: FloatArray) -> float:
        hats = np.stack([np.interp(fine, kept, unit) for unit in np.eye(len(kept))], axis=1)
        square = triangle[:, :-1] @ scipy.linalg.block_diag(1.0, *[hats] * family.count)
        right = triangle[:, -1]
        return float(np.sum((right - square @ np.linalg.lstsq(square, right, rcond=None)[0]) ** 2))

    kept, forms = fine, list[ElementForm]()
    while len(kept) > 2:
        place = min(range(1, len(kept) - 1), key=lambda k: measure(np.delete(kept, k)))
        kept = np.delete(kept, place)
        forms.append(ElementForm(family=replace(family, places=tuple(kept.tolist()))))
    forms = forms[-len(family.places) :]
    trials = [_try(form, task, shape) for form in forms]
    return forms[trials.index(_choose(trials)[0])]


def _fit_spring(task: _Task, *, knees: bool) -> _ElementTrial:
    """Return a passive spring with stops, and knees where they help, where the data put them."""
    path, output = task.data.path, task.data.counted
    # Virgin at the first sample is fitted as virgin at zero, and tried as it is.
    side = {"below": -1.0, "above": 1.0}.get(path.start, 0.0)
    ahead = [path.position[0] + side * 4.0 * path.reach, path.position[0]] if side else []
    torsion: FloatArray = np.append(ahead, path.position)
    first = len(ahead) + int(np.argmax(task.data.kept))
    spring = spring_fit.SpringData.build((torsion,), (1.0,), (slice(first, None, 1),), np.inf)
    spring = spring.rebuild(path.list_lengths(GRID))
    found = spring.fit_stops(output)
    if knees:
        places = spring_fit.build_knee_grid([part @ found.stiffness for part in spring.basis], STARTS)
        begun = replace(found, knees=places, slopes=np.ones(len(places)))
        found = spring_fit.fit_spring(spring, output, begun)
    elasticity = spring_fit.build_elasticity(spring_fit.refine_spring(spring, output, found))
    found = spring_fit.read_weights(elasticity)
    basis = joint_models.compute_stop_basis(torsion, found.thresholds)
    slips = spring_fit.compute_slips(basis, found.thresholds)
    jacobian = spring_fit.compute_spring_slopes(basis, found, slips)[first:, :-1]
    names = ("stiffness", "slopes", "thresholds", "knees")
    numbers = [getattr(found, name) for name in names]

    def rebuild(point: FloatArray) -> joint_models.Elasticity:
        parts = dict(zip(names, np.split(point, np.cumsum(list(map(len, numbers)))[:-1]), strict=True))
        return spring_fit.build_elasticity(spring_fit.SpringWeights(**parts))

    error = output - predict_output(elasticity, path)[task.data.kept]
    held = np.empty((0, jacobian.shape[1]))
    optimum = _Optimum(point=np.concatenate(numbers), jacobian=jacobian, error=error, held=held)
    stops = ElementForm(family=families.Stops(count=len(found.thresholds), searched=True))
    name, form = "prandtl-ishlinskii", "passive, thresholds from the data"
    source, refit = None if elasticity.knees else stops, partial(_fit_spring, knees=knees)
    losses = optimum.measure(task)
    name = f"modified-{name}" if elasticity.knees else name
    return _ElementTrial(name, form, optimum, rebuild, losses, refit, source, found.thresholds)


def measure_return(x: FloatArray) -> float:
    """Return the widest way of an input (N,) in the direction that it goes less far, over its range."""
    ways = [float(x[high - 1] - x[low]) for low, high in find_strokes(x)]
    return max(0.0, min(max(ways), -min(ways))) / float(np.ptp(x))


def find_strokes(x: FloatArray, share: float = POLICY.relevance) -> list[tuple[int, int]]:
    """Return first and last sample, exclusive, of each way of an input (N,) between two reversals.

    A reversal counts where the input then goes back by more than a `share` of its range.
    """
    bounds, extreme, sense = [0], 0, 0.0
    least = share * float(np.ptp(x))
    # Where the sense of the input does not change, neither an extreme nor a reversal can be.
    senses = np.sign(np.diff(x, prepend=np.nan, append=np.nan))
    turns = np.flatnonzero(senses[1:] != senses[:-1])
    for k, place in zip(turns.tolist(), x[turns].tolist(), strict=True):
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


def _list_trials(task: _Task, model: str) -> list[_ElementTrial]:
    """Return every form of a model, or of all of them, with the parts that help."""
    wanted = HYSTERESIS_MODELS if model == "auto" else (model,)
    found: list[_ElementTrial] = []
    for name in wanted:
        if name == "modified-prandtl-ishlinskii":
            spring = _fit_spring(task, knees=True)
            # Without knees it is the plain model.
            found += [spring] if name in {spring.model, model} else []
        if name == "prandtl-ishlinskii":
            found.append(_fit_spring(task, knees=False))
        for family in families.list_families(name, task.data.path, timed=task.timed):
            form = ElementForm(family=family)
            if isinstance(family, families.NonlinearStops):
                form = _refine_places(family, task)
            found.append(_fit_form(form, task, family.list_starts(task.data.path)))
    if task.passive:
        found = [trial for trial in found if joint_models.is_passive_element(trial.elasticity)]
    if not found:
        kind = "passive element" if task.passive else "element"
        text = f"no {kind} of model {model} explains the recording; try passive=None, or model auto"
        raise UsageError(Notice(code="usage.no-hysteresis", text=text))
    return found


def _extend(trial: _ElementTrial, task: _Task) -> list[_ElementTrial]:
    """Return the model behind a gap, and beside a spring that relaxes, where a start predicts better."""
    source, shape, path = trial.source, trial.shape, task.data.path
    if source is None:
        return []
    # Stops that a passive fit has placed stay springs.
    plain = isinstance(source.family, families.Stops) and not source.family.far
    springs = plain and joint_models.is_passive_element(trial.elasticity)
    possible = {"backlash": not task.passive, "relaxation": task.timed}
    task, found = replace(task, passive=task.passive or springs), []
    for part in (name for name, allowed in possible.items() if allowed and name not in source.parts):
        times = np.geomspace(np.min(path.period), np.sum(path.period), families.STARTS)
        sizes = path.list_lengths(families.STARTS) if part == "backlash" else times
        starts = [np.append(shape, value) for value in sizes]
        added, others = (*source.added, part), [name for name in source.parts if name not in source.added]
        whole = replace(source, parts=(*added, *others))
        begun = min(starts, key=lambda start: float(np.sum(_compute_errors(whole, task, start) ** 2)))
        if _is_better(trial.losses, _try(whole, task, begun).losses):
            found.append(_fit_form(replace(source, parts=added), task, starts))
    return found


def _choose(trials: Sequence[_ElementTrial]) -> list[_ElementTrial]:
    """Return the models by what they predict, behind the plainest that is not surely worse than the best."""
    ranked = sorted(trials, key=lambda trial: trial.score)
    equal = [trial for trial in ranked if not _is_better(trial.losses, ranked[0].losses)]

    def count(trial: _ElementTrial) -> tuple[int, int]:
        # A part that is zero is not counted, and is not wanted either.
        return len(trial.optimum.point), len(trial.source.parts) if trial.source else 0

    chosen = min(equal, key=count)
    return [chosen, *(trial for trial in ranked if trial is not chosen)]


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
    runs: dict[tuple[joint_models.Start, bool], tuple[_Task, list[_ElementTrial]]] = {}
    while (key := (whole.path.start, bool(whole.kept[0]))) not in runs:
        task = _Task(data=whole.thin(SAMPLES), passive=bool(options.passive), timed=t is not None)
        # The models, the chosen one first, with the further parts that they turn out to need.
        trials = _list_trials(task, options.model)
        ranked = _choose([*trials, *(further for trial in trials for further in _extend(trial, task))])
        ranked = _choose([*_extend(ranked[0], task), *ranked])
        runs[key] = task, ranked
        # Perhaps the model that was found explains more with another start, or is not of this one.
        paths = [replace(task.data.path, start=start) for start in _STARTS]
        tasks = [replace(task, data=replace(task.data, path=path)) for path in paths]
        others = {start: ranked[0].refit(other) for start, other in zip(_STARTS, tasks, strict=True)}
        best = min(others, key=lambda start: others[start].score)
        if _is_better(ranked[0].losses, others[best].losses):
            whole = replace(whole, path=replace(whole.path, start=best))
        else:
            whole = _find_memory(ranked[0].elasticity, whole)
    task, ranked = runs[key]
    whole = _find_memory(ranked[0].elasticity, whole)
    chosen = ranked[0]
    spread, scale = float(np.std(whole.counted)), float(np.std(task.data.counted))
    candidates = []
    for trial in ranked:
        held = 100.0 * math.sqrt(trial.score)
        # That of the sum of the parts.
        error = float(np.std(trial.losses, ddof=1)) * math.sqrt(_PARTS)
        candidate = HysteresisCandidate(
            model=trial.model,
            form=trial.form,
            count=len(trial.optimum.point),
            passive=joint_models.is_passive_element(trial.elasticity),
            fitted=100.0 * float(np.std(trial.optimum.error)) / scale,
            held_out=held,
            spread=0.5 * held * error / max(trial.score, numerics.TINY),
        )
        candidates.append(candidate)
    elasticity = chosen.elasticity
    predicted = predict_output(elasticity, whole.path)
    every, time = slice(None, None, max(1, len(predicted) // SAMPLES)), np.cumsum(whole.path.period)
    trace = ElementTrace(
        time=(time - time[0])[every],
        position=whole.path.position[every],
        measured=whole.output[every],
        predicted=predicted[every],
    )
    # The numbers of the element, and how they follow what the data decide.
    centre = joint_models.list_element_values(elasticity)
    points = np.array([chosen.optimum.leave_out(task.part == number)[1] for number in range(_PARTS)])
    point, rates = chosen.optimum.point, []
    for k, step in enumerate(numerics.CONVERGED * np.where(point, np.abs(point), 1.0)):
        moved = point + step * (np.arange(len(point)) == k)
        after = joint_models.list_element_values(chosen.rebuild(moved))
        rates.append([(after.get(name, value) - value) / step for name, value in centre.items()])
    deviations = np.linalg.norm(compute_changes(points) @ rates, axis=0)
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
        fitted=100.0 * float(np.std((y - predicted)[whole.kept])) / spread,
        held_out=candidates[0].held_out,
        last_quarter=_predict_last_quarter(chosen, task, whole),
        samples=len(x),
        skipped=int(np.count_nonzero(~whole.kept)),
        span=(float(x.min()), float(x.max())),
        speed=float(np.max(np.abs(whole.path.velocity))),
        output=spread,
        timed=task.timed,
        trace=trace,
    )


def _predict_last_quarter(trial: _ElementTrial, task: _Task, whole: ElementData) -> float:
    """Return what the model leaves of the last quarter of the way, fitted anew to the rest, percent."""
    data, path = task.data, task.data.path
    last = int(np.argmax(4 * _cut(whole.path.position) >= 3 * _PARTS))
    count = int(np.searchsorted(np.cumsum(path.period), np.cumsum(whole.path.period)[last]))
    parts = path.position[:count], path.velocity[:count], path.period[:count]
    early = replace(path, position=parts[0], velocity=parts[1], period=parts[2])
    first = ElementData(path=early, output=data.output[:count], kept=data.kept[:count])
    again = trial.refit(replace(task, data=first))
    error = (whole.output - predict_output(again.elasticity, whole.path))[last:]
    return 100.0 * float(np.std(error)) / float(np.std(whole.counted))


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
    if reason or slope is None or slope.value > POLICY.printed * slope.deviation:
        return reason
    return (
        f"k0 = {slope.value:.3g} +- {slope.deviation:.2g} does not differ significantly from zero: large "
        "outputs may need any input, or have none"
    )


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
        text = f"these outputs need inputs from {x.min():.4g} to {x.max():.4g}; the fit saw {low:.4g} to "
        text += f"{high:.4g}. Ask for smaller outputs, or fit a recording that reaches so far (beyond=True "
        text += "goes there all the same)"
        raise UsageError(Notice(code="usage.inverse-beyond", text=text))
    return x


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
    path: ElementPath,
    output: FloatArray,
    kept: NDArray[np.bool_],
    known: joint_models.Elasticity,
    speed: FloatArray,
) -> tuple[joint_models.Elasticity, str, float, float]:
    """Return the spring of a joint that predicts its torque best with as few numbers as that takes.

    A linear one, Bouc-Wen elements, stops without knees, springs of two stiffnesses, one on each side, all
    passive and with viscous or cubic parts where these help, and `known`, all by what they predict of parts
    that were left out; the linear one stays where none is clearly better.

    Args:
        path: torsion (N,), rad or m.
        output: (N,) N m or N.
        kept: (N,) samples that count.
        known: a spring that was fitted to the same.
        speed: (N,) rad/s or m/s, of the link, whose friction is no reason to leave the linear spring.

    Returns:
        the spring; its name, "" for `known`; what it and `known` leave of the output, percent.
    """
    whole = ElementData(path=path, output=output, kept=kept)
    index, data = whole.list_thin(SAMPLES), whole.thin(SAMPLES)
    # What is taken begins where dynamics and springs are fitted together.
    rounds = numerics.ROUNDS // STARTS
    task = _Task(data=data, passive=True, timed=True, tolerance=EXACT, rounds=rounds)
    loops, sided = (families.list_families(name, data.path, timed=True) for name in ("bouc-wen", "sided"))
    tried: tuple[families.ElementFamily, ...] = (
        families.Stops(count=0, name="linear"),
        families.Stops(count=GRID, name="stops"),
        *loops,
        *(family for family in sided if not family.searched),
    )
    trials = [_fit_form(ElementForm(family=family), task, family.list_starts(data.path)) for family in tried]

    # Along all samples: a thin path misses small reversals.
    pieces = zip(path.split(), np.split(index, np.searchsorted(index, path.begins[1:])), strict=True)
    tracks = [joint_models.PlayPath.build(part.position, own - own[0]) for part, own in pieces]

    def predict(spring: joint_models.Elasticity) -> FloatArray:
        weights = spring_fit.read_weights(spring)
        bases = np.concatenate([track.follow_stops(weights.thresholds)[1] for track in tracks])
        return spring_fit.compute_outer(bases, weights)[data.kept]

    # Sensors may have other zeros.
    rates = spring_fit.differentiate_spring(known, predict)
    columns = np.column_stack([rates, np.ones(len(rates))])
    point, held = np.zeros(columns.shape[1]), np.empty((0, columns.shape[1]))
    optimum = _Optimum(point=point, jacobian=columns, error=data.counted - predict(known), held=held)
    own, linear, best = optimum.measure(task), trials[0], _choose(trials)[0]
    left, worse = 100.0 * math.sqrt(float(own.sum())), best.score > float(own.sum())
    # A line, friction of the link, and a damper where it helps.
    parts = [data.path.position, np.ones_like(data.output), speed[index]]
    parts += [data.path.velocity] if "viscous" in linear.form else []
    columns = np.column_stack(parts)[data.kept]
    point = np.asarray(np.linalg.lstsq(columns, data.counted, numerics.RANK)[0], np.float64)
    error = data.counted - columns @ point
    straight = replace(optimum, point=point, jacobian=columns, error=error, held=columns[:0]).measure(task)
    found = compare(straight, own if worse else best.losses)
    # Nothing but a clear fall is a reason to call a spring anything but linear.
    if not (found.p_of_all < POLICY.alarm and found.fall_of_all > POLICY.fall_of_all):
        stiffness, damping = (max(0.0, float(np.sum(part))) for part in (point[0], point[3:]))
        plain = joint_models.Elasticity(stiffness=stiffness, damping=damping)
        name = "linear, viscous" if damping else "linear"
        return plain, name, 100.0 * math.sqrt(float(straight.sum())), left
    if worse:
        return replace(known, offset=0.0), "", left, left
    name = ", ".join((best.model, *(word for word in ("viscous", "cubic") if word in best.form)))
    # Encoders are brought into line by what gravity does, which leaves some of their offset.
    return replace(best.elasticity, offset=0.0), name, 100.0 * math.sqrt(best.score), left


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
    data = _find_memory(record.elasticity, _prepare(x, y, t))
    error = (y - predict_output(record.elasticity, data.path))[data.kept]
    low, high = record.span
    slack = POLICY.relevance * (high - low)
    inverse = None
    if not describe_inversion(record):
        # How far the inputs are that give the measured outputs.
        thin = data.thin(SAMPLES)
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
