"""Friction with a state, identified from one joint's samples: bristles, or elements that slip one by one.

    tau = Phi(x, dq; s) c + X other + noise,    Phi: columns along the whole path, simulated for unknowns s

    bristles    z(x) = z_e + (z - z_e) exp(-|x| / (d g)),  z_e = d g sign(x),  Phi = [z / d, dz/dt, dq, 1]
                c = [Fc, sigma1, Fv, offset],  d = Fc / sigma0
    elements    z_k(x) = clamp(z_k + x, -+ r_k g),  Phi = [z_1 .. z_m, dq, 1]
                c = [stiffness_k, Fv, offset],  Fc = sum r_k stiffness_k,  share_k = r_k stiffness_k / Fc
    g(dq) = 1 + Fe / Fc exp(-|dq / vs|^gamma), or 1

The torque is linear in c, so that few unknowns are searched (variable projection, Golub and Pereyra 1973): d
or r_k, Fe / Fc, vs. Thresholds r_k begin on a grid from the step of the samples to the reach of the motion;
those remain whose stiffness is not zero by least squares without negative values (Lawson and Hanson 1974),
neighbours as one where this leaves as little. gamma is 1 or 2. Deviations are those of a jackknife over
stretches, since what is left of such a model is not white.

A law with a state is compared with a static one at all rows, slow ones too: parts that are held out are
predicted after a Gauss-Newton step without their stretch.

Supported: several recordings, each from rest or from sliding either way; columns beside friction; filters.
Not supported: turning back between two samples; position noise that is not small against the way on which
bristles bend; an attraction of elements that takes time.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from symid.arrays import FloatArray, compute_triangle
from symid.errors import IdentifiabilityError, Notice
from symid.identification.estimators import ParameterEstimate
from symid.identification.friction import joint_fit
from symid.identification.friction.joint_fit import FrictionEstimate, FrictionSamples
from symid.identification.judge import POLICY, compute_changes, compute_variance, numerics
from symid.ipopt import Ending
from symid.joint_models import FrictionLaw, compute_clamps, find_turns, list_state_parameters, name_bristles

MEMORY_LAWS = ("dahl", "maxwell-slip", "lugre", "generalised-maxwell-slip")
"""Laws with a state among which `auto` chooses, from plain to rich; with an offset where there is one."""
_NODES = 24
"""Lengths of the grid of starts."""
_EXPONENTS = (2.0, 1.0)


class BristlePath(NamedTuple):
    """A motion of N samples.

    `position` rad or m, `velocity` rad/s or m/s, `way` since the sample before, 0 where a recording `begins`:
    there bristles are straight, or bent as by sliding forwards or backwards (`sides` 0, 1, -1).
    """

    position: FloatArray
    velocity: FloatArray
    way: FloatArray
    begins: list[int]
    sides: tuple[int, ...]


def build_path(samples: FrictionSamples) -> BristlePath:
    """Return the path of the samples; an IdentifiabilityError where nothing can bend."""
    position, run = samples.position, samples.run
    if position is None or run is None or not np.any(np.diff(position)):
        text = f"joint {samples.joint!r}: no positions, or nothing moves; what bristles do is identified "
        text += "from the displacement of the joint while it sticks and begins to slip"
        raise IdentifiabilityError(Notice(code="friction.presliding-position", text=text))
    begins = np.flatnonzero(np.diff(run, prepend=-1) != 0).tolist()
    way = np.diff(position, prepend=position[:1])
    way[begins] = 0.0
    return BristlePath(position, samples.velocity, way, begins, (0,) * len(begins))


def _bend(path: BristlePath, bend: float, level: FloatArray) -> FloatArray:
    """Return z / d (N,) of bristles that bend by d = `bend` before they slip; `level` is g (N,)."""
    factors = np.exp(-np.abs(path.way) / (bend * level))
    goals = level * np.sign(path.way) * (1.0 - factors)
    factors[path.begins], goals[path.begins] = 0.0, np.array(path.sides) * level[path.begins]
    # z <- factor z + goal: steps in a row are such a step. Blocks become one each and are run through in
    # order, then all are filled at once.
    count, length = len(factors), math.isqrt(len(factors))
    blocks = -(-count // length)
    padding = (0, blocks * length - count)
    steps = [np.pad(part, padding).reshape(blocks, length).T.copy() for part in (factors, goals)]
    whole, moved = np.ones(blocks), np.zeros(blocks)
    for factor, goal in zip(*steps, strict=True):
        whole, moved = factor * whole, factor * moved + goal
    state, states = 0.0, np.zeros(blocks)
    for k, (factor, goal) in enumerate(zip(whole.tolist(), moved.tolist(), strict=True)):
        states[k] = state
        state = factor * state + goal
    found = np.empty((length, blocks))
    for factor, goal, row in zip(*steps, found, strict=True):
        states = factor * states + goal
        row[:] = states
    return found.T.ravel()[:count]


def _slip(path: BristlePath, radii: FloatArray, level: FloatArray) -> FloatArray:
    """Return the deflections (N, m) of elements that slip at `radii` (m,) times `level` (N,)."""
    found = []
    ends = [*path.begins[1:], len(path.way)]
    for first, last, side in zip(path.begins, ends, path.sides, strict=True):
        x = path.position[first:last, None]
        most = radii * level[first:last, None]
        # Where levels move with the speed, bounds do not follow the position up and down.
        turns = None if np.ptp(level) > 0.0 else find_turns(x[:, 0])
        found.append(x - compute_clamps(x - most, x + most, x[0] - side * most[0], turns))
    return np.concatenate(found)


class _LinearFactors(NamedTuple):
    """A fit for given shape values: c (p,) of the law, other (k,), and what is left of the rows (M,)."""

    linear: FloatArray
    other: FloatArray
    left: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MemoryProblem:
    """A law with a state, on samples.

    The unknowns inside the columns are `lengths` at which it slips, d of bristles or r_k of elements, then
    Fe / Fc and vs where its level falls. `exponent` is its gamma, `damped` whether bristles have a damper.
    """

    samples: FrictionSamples
    law: FrictionLaw
    path: BristlePath
    exponent: float
    lengths: int
    damped: bool

    @property
    def signed(self) -> int:
        """Return how many columns of the law, the first ones, have factors that are not negative."""
        return self.lengths + self.damped + 1

    def compute_columns(self, shape: FloatArray) -> FloatArray:
        """Return Phi (N, p) for the unknowns (s,)."""
        speed, lengths = self.path.velocity, shape[: self.lengths]
        level = np.ones(len(speed))
        if self.law.shape:
            fall, scale = shape[self.lengths :].tolist()
            level += fall * np.exp(-(np.abs(speed / scale) ** self.exponent))
        if self.law.elements:
            own = _slip(self.path, lengths, level)
        else:
            bent = _bend(self.path, float(lengths[0]), level)
            own = np.column_stack([bent, speed - np.abs(speed) * bent / level])[:, : 1 + self.damped]
        last = [np.ones(len(speed))] if self.law.linear[-1].name == "offset" else []
        return np.column_stack([own, speed, *last])

    def compute_slopes(self, shape: FloatArray, own: FloatArray, linear: FloatArray) -> FloatArray:
        """Return the derivatives (N, s) of Phi c by logarithms of the unknowns; `own` is Phi (N, p)."""
        step, count = float(np.sqrt(numerics.CONVERGED)), self.lengths
        # Each length moves its own column only, and that of a damper.
        moved = self.compute_columns(np.append(shape[:count] * np.exp(step), shape[count:]))
        slopes = (moved - own) * linear
        found = [slopes[:, :count] if self.law.elements else slopes.sum(axis=1)]
        for place in range(count, len(shape)):
            moved = self.compute_columns(shape * np.exp(np.where(np.arange(len(shape)) == place, step, 0.0)))
            found.append((moved - own) @ linear)
        return np.column_stack(found) / step

    def compute_changes(self, shape: FloatArray) -> FloatArray:
        """Return the derivatives (M, s) of what is left by logarithms of the unknowns, as Kaufman has them.

        BIT 15 (1975) 49-57: the factors follow, those at zero stay.
        """
        own, rows, found = self.compute_columns(shape), self.samples.rows, self.fit(shape)
        slopes = self.samples.pass_columns(self.compute_slopes(shape, own, found.linear))
        free = np.append(
            found.linear[: self.signed] > 0.0, np.ones(own.shape[1] - self.signed, dtype=np.bool_)
        )
        columns = np.hstack([self.samples.pass_columns(own[:, free]), rows.extra])
        basis, _ = np.linalg.qr(columns / np.maximum(np.linalg.norm(columns, axis=0), numerics.TINY))
        return np.asarray(basis @ (basis.T @ slopes) - slopes)

    def fit(self, shape: FloatArray) -> _LinearFactors:
        """Return the best factors of all columns: of elements, damping and dry friction none is negative."""
        rows = self.samples.rows
        columns = np.hstack([self.samples.pass_columns(self.compute_columns(shape)), rows.extra])
        count = columns.shape[1] - rows.extra.shape[1]
        sizes = np.maximum(np.linalg.norm(columns, axis=0), numerics.TINY)
        triangle = compute_triangle(np.column_stack([columns / sizes, rows.torque]))
        low = np.full(columns.shape[1], -np.inf)
        low[: self.signed] = 0.0
        bounds, square = (low, np.inf), triangle[:, :-1]
        found = scipy.optimize.lsq_linear(square, triangle[:, -1], bounds, method="bvls").x / sizes
        return _LinearFactors(found[:count], found[count:], rows.torque - columns @ found)

    def list_values(
        self, linear: FloatArray, shape: FloatArray
    ) -> tuple[list[float], list[float], list[float]]:
        """Return linear, shape and state values of the law, as robot files have them."""
        lengths, own, rest = shape[: self.lengths], linear[: self.lengths], linear[self.signed - 1 :].tolist()
        fall, scale = shape[self.lengths :].tolist() if self.law.shape else (0.0, 0.0)
        coulomb = float(own @ lengths) if self.law.elements else float(own[0])
        values = {"Fc": coulomb, "Fe": fall * coulomb, "Fv": rest[0], "offset": rest[-1]}
        values |= {"vs": scale, "gamma": self.exponent}
        if self.law.elements:
            bristles = [*own.tolist(), *(own * lengths / max(coulomb, numerics.TINY)).tolist()]
        else:
            damping = float(linear[1]) if self.damped else 0.0
            bristles = [coulomb / float(lengths[0]), damping][: len(self.law.memory)]
        names = ([entry.name for entry in part] for part in (self.law.linear, self.law.shape))
        own_values, bent = ([values[name] for name in part] for part in names)
        return own_values, bent, bristles

    def list_edges(self) -> list[tuple[float, float]]:
        """Return the least and the largest of each unknown that the motion supports."""
        speeds = np.abs(self.path.velocity[self.path.velocity != 0.0])
        ways = np.abs(self.path.way[self.path.way != 0.0])
        fastest = float(np.max(speeds))
        lengths = (POLICY.relevance * float(np.median(ways)), 0.5 * float(np.ptp(self.path.position)))
        falls = (POLICY.relevance**2, 1.0 / POLICY.relevance)
        slowest = max(float(np.quantile(speeds, POLICY.alarm)), fastest * numerics.CONVERGED)
        return [lengths] * self.lengths + ([falls, (slowest, fastest)] if self.law.shape else [])

    def scan(self, nodes: Sequence[Sequence[float]]) -> "_Search":
        """Return the best combination of `nodes` of all unknowns."""
        grid = list(map(np.array, itertools.product(*nodes)))
        losses = [_measure(node, self) for node in grid]
        best = min(range(len(grid)), key=losses.__getitem__)
        return _Search(grid[best], losses[best], len(grid))

    def move(self, shape: FloatArray, held: int) -> "_Search":
        """Return the best unknowns near `shape` (s,), the first of which are `held`."""
        if held == len(shape):
            return self.scan(shape[:, None].tolist())
        low, high = np.array(self.list_edges()[held:]).T
        size = float(np.linalg.norm(self.samples.rows.torque)) or 1.0

        def build(logs: FloatArray) -> FloatArray:
            return np.append(shape[:held], np.exp(logs))

        found = scipy.optimize.least_squares(
            lambda logs: self.fit(build(logs)).left / size,
            np.log(np.clip(shape[held:], low, high)),
            jac=lambda logs: self.compute_changes(build(logs))[:, held:] / size,
            bounds=(np.log(low), np.log(high)),
            xtol=numerics.CONVERGED,
            ftol=numerics.CONVERGED,
            max_nfev=numerics.ROUNDS,
        )
        return _Search(build(found.x), 2.0 * float(found.cost) * size**2, int(found.nfev))


def _choose_starts(problem: MemoryProblem, measure: Callable[[MemoryProblem], float]) -> MemoryProblem:
    """Return the problem with the memory at the beginning of every recording that leaves least."""
    for number in range(len(problem.path.sides)):
        before, after = problem.path.sides[:number], problem.path.sides[number + 1 :]
        paths = (problem.path._replace(sides=(*before, side, *after)) for side in (0, 1, -1))
        problem = min((replace(problem, path=path) for path in paths), key=measure)
    return problem


def _measure(shape: FloatArray, problem: MemoryProblem) -> float:
    return float(np.sum(problem.fit(shape).left ** 2))


class _Search(NamedTuple):
    """The end of a search: unknowns (s,), their J, and how many were tried."""

    shape: FloatArray
    objective: float
    tried: int


def _list_nodes(problem: MemoryProblem) -> list[Sequence[float]]:
    """Return values where searches begin: of lengths, one for each element, then of the fall."""
    speeds = np.abs(problem.path.velocity[problem.path.velocity != 0.0])
    falls = [[1.0], np.quantile(speeds, (0.2, 0.6)).tolist()] if problem.law.shape else []
    if not problem.law.elements:
        low, high = problem.list_edges()[0]
        return [np.geomspace(low, high, _NODES).tolist(), *falls]
    step, reach = float(np.mean(np.abs(problem.path.way))), 0.5 * float(np.ptp(problem.path.position))
    grid = np.geomspace(step, max(reach, 2.0 * step), problem.lengths, endpoint=False)
    return [*grid[:, None].tolist(), *falls]


def _move_elements(problem: MemoryProblem, shape: FloatArray) -> tuple[MemoryProblem, _Search]:
    """Return the better of joined elements and of all of a grid, without those that carry next to nothing."""
    rows, trials = len(problem.samples.rows.torque), list[tuple[float, MemoryProblem, _Search]]()
    tail = len(shape) - problem.lengths
    # Elements that have a stiffness alone, neighbours among them as one.
    grid, falling = np.split(shape, [problem.lengths])
    stiffness = problem.fit(shape).linear[: len(grid)]
    there = np.flatnonzero(stiffness > 0.0)
    groups = np.split(there, np.flatnonzero(np.diff(there) > 1) + 1) if len(there) else []
    means = [float(np.exp(np.average(np.log(grid[k]), weights=stiffness[k]))) for k in groups]
    joined = np.array([*means, *falling])

    def keep(search: _Search) -> None:
        count = len(search.shape) - tail
        score, _ = joint_fit.compute_criteria(search.objective, rows, 2 * count)
        trials.append((score, replace(problem, lengths=count), search))

    def strip(some: MemoryProblem, shape: FloatArray, least: float) -> FloatArray:
        carried = some.fit(shape).linear[: some.lengths] * shape[: some.lengths]
        kept = carried > least * carried.sum()
        return np.asarray(shape[np.append(kept, np.ones(tail, dtype=np.bool_))])

    for start in (joined, strip(problem, shape, 0.0)):
        keep(replace(problem, lengths=len(start) - tail).move(start, 0))
    _, best, search = min(trials, key=lambda trial: trial[0])
    shape = strip(best, search.shape, POLICY.relevance)
    keep(replace(problem, lengths=len(shape) - tail).move(shape, 0))
    if len(strip(best, search.shape, 0.0)) < len(search.shape):
        trials = trials[-1:]
    _, best, last = min(trials, key=lambda trial: trial[0])
    return best, last._replace(tried=sum(one.tried for _, _, one in trials))


class MemoryFit(NamedTuple):
    """A fit of a law with a state, and its derivatives F (M, n) by all unknowns, for predictions held out."""

    estimate: FrictionEstimate
    design: FloatArray
    left: FloatArray


def fit_memory(samples: FrictionSamples, law: FrictionLaw) -> MemoryFit:
    """Return the values of a law with a state, all from the same samples, which have positions.

    Raises:
        IdentifiabilityError: no positions, nothing moves, nothing slips, or fewer rows than unknowns.
    """
    path, count = build_path(samples), len(samples.rows.torque)
    damped = len(law.memory) > 1 and not law.elements
    lengths, exponents = _NODES if law.elements else 1, _EXPONENTS if law.shape else _EXPONENTS[:1]
    unknowns = lengths + len(law.linear) + len(law.shape) + damped + samples.rows.extra.shape[1]
    if count <= unknowns:
        text = f"joint {samples.joint!r}: {count} samples are too few for {unknowns} unknowns of {law.name!r}"
        raise IdentifiabilityError(Notice(code="friction.few-rows", text=text))
    trials, held = [], lengths if law.elements else 0
    for exponent in exponents:
        whole = MemoryProblem(
            samples=samples, law=law, path=path, exponent=exponent, lengths=lengths, damped=damped
        )
        begun = whole.scan(_list_nodes(whole))
        whole = _choose_starts(whole, partial(_measure, begun.shape))
        moved = whole.move(begun.shape, held)
        trials.append((whole, moved._replace(tried=begun.tried + moved.tried)))
    problem, found = min(trials, key=lambda trial: trial[1].objective)
    tried = sum(one.tried for _, one in trials)
    if law.elements:
        problem, found = _move_elements(problem, found.shape)
        tried += found.tried
    # What was remembered first shows better where the law is known.
    again = _choose_starts(problem, partial(_measure, found.shape))
    if again.path.sides != problem.path.sides:
        problem, found = again, again.move(found.shape, 0)
        tried += found.tried
    made = _build_fit(problem, found.shape, tried)
    if damped and "sigma1" in dict(made.estimate.refused):
        # Bristles whose damping nothing shows have none.
        problem = replace(problem, damped=False)
        found = problem.move(found.shape, 0)
        made = _build_fit(problem, found.shape, tried + found.tried)
    return made


def _build_fit(problem: MemoryProblem, shape: FloatArray, tried: int) -> MemoryFit:
    """Return what the unknowns (s,) say, after so many were `tried`."""
    samples, law, rows, found = problem.samples, problem.law, problem.samples.rows, problem.fit(shape)
    coulomb = problem.list_values(found.linear, shape)[0][[entry.name for entry in law.linear].index("Fc")]
    if not coulomb > 0.0:
        text = f"joint {samples.joint!r}: these samples show no dry friction with the hysteresis of "
        text += f"{law.name!r}"
        raise IdentifiabilityError(Notice(code="friction.presliding-nothing", text=text))
    size, count = len(shape), len(found.linear)
    own = problem.compute_columns(shape)
    # Derivatives by logarithms of unknowns, then by all factors that are not held at zero.
    columns = samples.pass_columns(np.hstack([problem.compute_slopes(shape, own, found.linear), own]))
    free = np.ones(size + count, dtype=np.bool_)
    free[size : size + problem.signed] = found.linear[: problem.signed] > 0.0
    design = np.hstack([columns[:, free], rows.extra])
    unknowns = design.shape[1]
    parts, _ = joint_fit.cut_parts(rows)
    steps, lost = leave_out(design, found.left, parts, np.arange(len(parts)))
    changes = compute_changes(steps)
    # What every part changes of all unknowns, then of the law's values: linear, shape, state and other ones.
    whole = np.zeros((len(changes), size + count + len(found.other)))
    there = np.flatnonzero(np.append(free, np.ones(len(found.other), dtype=np.bool_)))
    whole[:, there] = changes

    def compute_values(unknown: FloatArray) -> FloatArray:
        linear, bent, bristles = problem.list_values(unknown[size : size + count], np.exp(unknown[:size]))
        return np.array([*linear, *bent, *bristles, *unknown[size + count :]])

    middle = np.concatenate([np.log(shape), found.linear, found.other])
    values, jacobian = compute_values(middle), np.empty((len(compute_values(middle)), len(middle)))
    for place, value in enumerate(middle.tolist()):
        width = numerics.CONVERGED * max(abs(value), numerics.CONVERGED)
        step = np.where(np.arange(len(middle)) == place, width, 0.0)
        jacobian[:, place] = (compute_values(middle + step) - compute_values(middle - step)) / (2.0 * width)
    moves = whole @ jacobian.T
    vague = np.any(jacobian[:, there[lost]] != 0.0, axis=1)
    scaled = compute_triangle(design / np.maximum(np.linalg.norm(design, axis=0), numerics.TINY))
    p, s, end = len(law.linear), len(law.shape), len(values) - len(found.other)
    bristles = values[p + s : end].tolist()
    mixing = np.eye(len(values))
    mixing[: p + s, : p + s] = law.mixing
    stds = np.where(np.abs(mixing) @ vague > 0.0, np.inf, compute_variance(moves @ mixing.T) ** 0.5).tolist()
    entries = [*law.physical, *list_state_parameters(law, len(bristles) // len(law.memory))[: len(bristles)]]
    numbers = [*law.to_physical(values[:p].tolist(), values[p : p + s].tolist()), *bristles]
    parameters, refused = list[ParameterEstimate](), dict[str, str]()
    for entry, value, std in zip(entries, numbers, stds, strict=False):
        name = entry.name
        unit = entry.unit_prismatic if samples.prismatic else entry.unit
        reason = "one of 1, 2" if name == "gamma" else "zero: none is seen" if value == 0.0 else ""
        sure = 100.0 * std <= POLICY.uncertain * abs(value)
        if not np.isfinite(std):
            refused[name] = _DEPENDENT
        elif not (sure or reason) and name in _NEEDS:
            refused[name] = f"its standard deviation, {std:.3g} {unit}, is too large: {_NEEDS[name]}"
        else:
            parameters.append(ParameterEstimate(name, value, std, unit, entry.meaning, reason))
    units = samples.extra_units or ("",) * len(samples.extra_names)
    beside = list(zip(samples.extra_names, found.other.tolist(), stds[end:], units, strict=True))
    refused |= {name: _DEPENDENT for name, _, std, _ in beside if not np.isfinite(std)}
    objective, rows_fitted = float(found.left @ found.left), len(found.left)
    aicc, bic = joint_fit.compute_criteria(objective, rows_fitted, unknowns)
    counted = moves[:, [*range(p + s), *range(end, len(values))]]
    texts = [f"{name} was left out: {reason}; record more reversals" for name, reason in refused.items()]
    estimate = FrictionEstimate(
        joint=samples.joint,
        law=law.name,
        parameters=tuple(parameters),
        extra=tuple(ParameterEstimate(*entry) for entry in beside if entry[0] not in refused),
        refused=tuple(refused.items()),
        other=tuple(found.other.tolist()),
        objective=objective,
        sigma=float(np.sqrt(objective / max(rows_fitted - unknowns, 1))),
        samples=rows_fitted,
        evaluations=tried,
        outcome=Ending.SOME_REFUSED if refused else Ending.CONVERGED,
        notices=tuple(Notice(code="friction.refused", text=text) for text in texts),
        estimator="varpro",
        linear=tuple(values[:p].tolist()),
        shape=tuple(values[p : p + s].tolist()),
        bristles=tuple(bristles),
        covariance=tuple(map(tuple, (counted.T @ counted).tolist())),
        solves=tried,
        iterations=0,
        ended="the search of shape values converged",
        aicc=aicc,
        bic=bic,
        condition=float(np.linalg.cond(scaled)),
    )
    return MemoryFit(estimate, design, found.left)


def leave_out(
    design: FloatArray, left: FloatArray, parts: Sequence[NDArray[np.intp]], fold: NDArray[np.intp]
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return the Gauss-Newton steps (f, n) of fits without each stretch of `parts`.

    And which unknowns (n,) one of these fits does not determine.
    """
    sizes = np.linalg.norm(design, axis=0)
    sizes[sizes == 0.0] = 1.0
    table = np.column_stack([design / sizes, left])
    grams = np.stack([table[part].T @ table[part] for part in parts])
    whole, steps, lost = grams.sum(axis=0), [], np.zeros(len(sizes), dtype=np.bool_)
    for one in range(int(fold.max()) + 1):
        rest = whole - grams[fold == one].sum(axis=0)
        values, directions = np.linalg.eigh(rest[:-1, :-1])
        null = values <= numerics.EXACT * max(float(values[-1]), numerics.TINY)
        known = directions[:, ~null]
        steps.append(known @ ((known.T @ rest[:-1, -1]) / values[~null]) / sizes)
        # A sum of products knows directions to the root of its digits.
        lost |= np.linalg.norm(directions[:, null], axis=1) > np.sqrt(numerics.CONVERGED)
    return np.array(steps), lost


_DEPENDENT = "it is linearly dependent where a stretch of the log is left out"
_NEEDS = {
    "sigma0": "the joint must stick and turn back within the presliding displacement, fC / sigma0",
    "sigma1": "the joint must move fast enough while it sticks: near 1 / s of sigma0 / sigma1",
    "fS": "the joint must break away slowly, or slip at speeds below vs",
    "vs": "the joint must slip at speeds around vs, and its friction must fall there",
    "fC": "the joint must slip",
}
"""What values need to be identified, where their deviation is large; elements share what they carry."""


def simulate_presliding(samples: FrictionSamples, law: FrictionLaw, estimate: FrictionEstimate) -> FloatArray:
    """Return the friction (N,), N m or N, of an estimate with a state along the samples.

    What bristles remember where a recording begins is what its rows choose.
    """
    named, bent = (
        dict(zip([entry.name for entry in entries], values, strict=True))
        for entries, values in ((law.linear, estimate.linear), (law.shape, estimate.shape))
    )
    memory, coulomb = name_bristles(law, estimate.bristles), named["Fc"]
    stiffness, damping = np.array(estimate.bristles[:1]), memory.get("sigma1", ())
    lengths, linear = coulomb / stiffness, [coulomb, *damping]
    if law.elements:
        stiffness = np.array(memory["stiffness"])
        lengths, linear = np.array(memory["share"]) * coulomb / stiffness, stiffness.tolist()
    linear += [named["Fv"], *([named["offset"]] if "offset" in named else [])]
    problem = MemoryProblem(
        samples=samples,
        law=law,
        path=build_path(samples),
        exponent=bent.get("gamma", _EXPONENTS[0]),
        lengths=len(lengths),
        damped=bool(damping),
    )
    shape = [*lengths.tolist(), *([named["Fe"] / coulomb, bent["vs"]] if law.shape else [])]
    own, rows = np.array(linear), samples.rows
    given = rows.torque - rows.extra @ np.array(estimate.other)

    def predict(some: MemoryProblem) -> FloatArray:
        return np.asarray(some.compute_columns(np.array(shape)) @ own)

    def measure(some: MemoryProblem) -> float:
        return float(np.sum((samples.pass_columns(predict(some)[:, None])[:, 0] - given) ** 2))

    return predict(_choose_starts(problem, measure))
