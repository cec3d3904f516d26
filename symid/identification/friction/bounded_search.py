"""Searches over all parameters of a friction law between bounds: Ipopt, genetic, annealing, evolution.

    nlp        min_x J(x), lower <= x <= upper, over the physical parameters x, so that fS >= 0, fC >= 0 hold
               f(x) = |y - Q R t(x)|^2 / scale, t(x) = sum_k c_k(x) Phi_k(v; s(x)), (c, s) = mixing^-1 x
               with exact first and second derivatives by CasADi; starts fill the box of the shape evenly
               (Roberts' generalised golden ratio), linear parameters by least squares
    genetic    tournament of two -> crossover of all parents -> the best of parents and children survive
               (our own design: Zhang, Hu and Zou (2021) do not say how theirs works)
    annealing  crossover and survival as above, then each candidate x moves to a neighbour x' if dJ < 0 or
               u < exp(-dJ / T), T_0 = J_max - J_min of the first generation, T_g+1 = cooling T_g; the best
               one never moves uphill (Metropolis et al., J. Chem. Phys. 21 (1953) 1087; Kirkpatrick, Gelatt
               and Vecchi, Science 220 (1983) 671-680)
    evolution  differential evolution of SciPy (Storn and Price, J. Global Optim. 11 (1997) 341-359)

The same state of the generator gives the same result; optima in a kink are not found to full precision.
"""

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.identification.friction.joint_fit import FrictionSearch
from symid.identification.friction.problem import (
    EvolutionOptions,
    FrictionNlpOptions,
    FrictionProblem,
    GeneticOptions,
    Projector,
)
from symid.ipopt import Ending, IpoptOptions, SmoothProblem, keep_last, minimise
from symid.joint_models import build_casadi_carrier


class FrictionNlpCost:
    """f, its gradient and Hessian, and how many points were evaluated."""

    def __init__(self, problem: FrictionProblem, scale: float) -> None:
        import casadi

        self.scale, self.evaluations = scale, 0
        law, size, count = problem.law, len(problem.law.physical), len(problem.law.linear)
        x, inputs = casadi.SX.sym("x", size), casadi.SX.sym("inputs", len(law.inputs))
        values = casadi.mtimes(casadi.DM(np.array(law.unmixing, dtype=np.float64)), x)
        named = {name: inputs[place] for place, name in enumerate(law.inputs)}
        shape = [values[count + place] for place in range(len(law.shape))]
        columns = law.columns(build_casadi_carrier(), named, shape)
        torque = casadi.dot(values[:count], casadi.vertcat(*columns))
        hessian, gradient = casadi.hessian(torque, x)
        bends = casadi.vertcat(*(hessian[i, j] for i in range(size) for j in range(i, size)))
        # x (n), inputs (i, N) -> torque (1, N), gradient (n, N), upper triangle of the Hessian.
        self.function = casadi.Function("torque", [x, inputs], [torque, gradient, bends])
        self.inputs = np.vstack([problem.samples.inputs[name] for name in law.inputs])
        self.upper = np.triu_indices(size)

        def compute_state(x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
            # Errors (M,), their derivatives (M, n), and errors' sum over second ones, upper triangle.
            self.evaluations += 1
            rows = [np.asarray(part, dtype=np.float64).T for part in self.function(x, self.inputs)]
            passed = problem.samples.pass_columns(np.hstack(rows))
            errors = problem.eliminate(passed[:, 0] - problem.target)
            slopes = problem.eliminate(passed[:, 1 : 1 + size])
            return errors, slopes, passed[:, 1 + size :].T @ errors

        self.compute_state = keep_last(compute_state)

    def compute_value(self, x: FloatArray) -> float:
        """Return f at x (n,)."""
        errors = self.compute_state(x)[0]
        return float(errors @ errors) / self.scale

    def compute_gradient(self, x: FloatArray) -> FloatArray:
        """Return df/dx: (n,)."""
        errors, slopes, _ = self.compute_state(x)
        return np.asarray(slopes.T @ errors * (2.0 / self.scale))

    def compute_hessian(self, x: FloatArray) -> FloatArray:
        """Return d2f/dx2: (n, n)."""
        _, slopes, bends = self.compute_state(x)
        hessian = slopes.T @ slopes
        second = np.zeros_like(hessian)
        second[self.upper] = bends
        second += np.triu(second, 1).T
        return np.asarray((hessian + second) * (2.0 / self.scale))


def search_by_nlp(problem: FrictionProblem, options: FrictionNlpOptions) -> FrictionSearch:
    """Return the least of the optima from several starts."""
    law, projector = problem.law, Projector(problem, np.iinfo(np.int64).max)
    # Bounds of the shape are those of the search.
    edges = zip(law.shape, problem.low, problem.high, strict=True)
    box = {entry.name: tuple(pair) for entry, *pair in edges}
    low, high = np.array([box.get(entry.name, (entry.lower, entry.upper)) for entry in law.physical]).T
    starts, (least, most), free = [], problem.box, int(np.sum(problem.is_free))
    # The root of g^(d+1) = g + 1, found by its own iteration: starts fill the box of the shape evenly.
    ratio = 2.0
    for _ in range(60):
        ratio = (1.0 + ratio) ** (1.0 / (free + 1))
    steps = ratio ** -np.arange(1.0, free + 1.0)
    for number in range(1, 8 * options.starts + 1 if free else 2):
        z = np.array(least)
        z[problem.is_free] += np.mod(0.5 + number * steps, 1.0) * (most - least)[problem.is_free]
        starts.append(z)
    states = [projector.project(z) for z in starts]
    states.sort(key=lambda state: state.objective)
    scale = max(states[0].objective, 1e-20 * float(problem.target @ problem.target), 1e-300)
    cost = FrictionNlpCost(problem, scale)
    smooth = SmoothProblem(
        value=cost.compute_value,
        gradient=cost.compute_gradient,
        hessian=cost.compute_hessian,
        lower=low,
        upper=high,
    )
    settings = IpoptOptions(tolerance=options.tolerance, iterations=options.iterations)
    history, runs, objectives = [states[0].objective], [], []
    for state in states[: options.starts]:
        start = np.clip(law.to_physical(list(state.linear), list(state.shape)), low, high)
        # One unit of a scaled unknown changes the objective by about one.
        bend = np.abs(np.diag(cost.compute_hessian(start)))
        scales = np.where(bend > 0.0, 1.0 / np.sqrt(np.where(bend > 0.0, bend, 1.0)), 1.0)
        runs.append(minimise(smooth, start, settings, scales))
        objectives.append(cost.compute_value(runs[-1].x) * cost.scale)
        history.append(min(history[-1], objectives[-1]) if runs[-1].outcome.usable else history[-1])
    usable = [place for place, run in enumerate(runs) if run.outcome.usable]
    place = min(usable or range(len(runs)), key=lambda place: objectives[place])
    best, objective = runs[place], objectives[place]
    iterations = sum(run.iterations for run in runs)
    linear, shape = law.from_physical([float(value) for value in best.x])
    same = sum(objectives[place] <= objective * (1.0 + 1e-6) for place in usable)
    return FrictionSearch(
        linear=linear,
        shape=shape,
        objective=objective,
        evaluations=cost.evaluations + projector.evaluations,
        solves=projector.solves + iterations,
        iterations=iterations,
        history=tuple(history),
        outcome=best.outcome,
        ended=f"Ipopt ended: {best.reason}; {same} of {len(runs)} starts end at this optimum",
        settings=(("starts", len(runs)), ("agreeing", same)),
    )


class UnitBoxProblem:
    """Candidates of a problem, mapped onto the unit box of dimension `size`, and their objective, counted."""

    def __init__(self, problem: FrictionProblem) -> None:
        self.problem, self.evaluations, self.history = problem, 0, list[float]()
        self.free = np.flatnonzero(problem.is_free)
        self.fixed, high = problem.box
        self.low = np.concatenate([problem.lower, self.fixed[self.free]])
        self.high = np.concatenate([problem.upper, high[self.free]])
        self.size = len(self.low)

    def express(self, genes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return linear (P, p) and shape (P, s) of genes (P, d)."""
        values = self.low + np.clip(genes, 0.0, 1.0) * (self.high - self.low)
        count = len(self.problem.lower)
        z = np.tile(self.fixed, (len(genes), 1))
        z[:, self.free] = values[:, count:]
        return values[:, :count], self.problem.decode(z)

    def compute_objectives(self, genes: FloatArray) -> FloatArray:
        """Return J (P,) of genes (P, d)."""
        self.evaluations += len(genes)
        return self.problem.compute_objectives(*self.express(genes))

    def build_search(
        self,
        options: GeneticOptions | EvolutionOptions,
        genes: FloatArray,
        objective: float,
        *,
        converged: bool,
        **settings: float | str,
    ) -> FrictionSearch:
        """Return the end of a search with the best candidate, genes (d,)."""
        linear, shape = self.express(genes[None, :])
        spread = f"the relative spread of the candidates' objectives fell below {options.tolerance:g}"
        return FrictionSearch(
            linear=tuple(linear[0].tolist()),
            shape=tuple(shape[0].tolist()),
            objective=objective,
            evaluations=self.evaluations,
            solves=0,
            iterations=len(self.history) - 1,
            history=tuple(self.history),
            outcome=Ending.STAGNATED if converged else Ending.LIMIT,
            ended=spread if converged else f"{options.generations} generations passed",
            settings=tuple(settings.items()),
        )


def compute_spread(objectives: FloatArray) -> float:
    """Return (worst - best) / best of objectives (P,); zero where all are zero."""
    best, worst = float(np.min(objectives)), float(np.max(objectives))
    return (worst - best) / best if best > 0.0 else float(worst > 0.0)


def draw_children(genes: FloatArray, parents: FloatArray, width: float, generator: Generator) -> FloatArray:
    """Return a child of each parent (P, d) by a crossover of all genes x (P, d), mirrored at the box's faces.

    child = parent + width / sqrt(P) sum_k w_k (x_k - mean), w_k standard normal: the steps have the
    population's own covariance, so that valleys in any direction are followed.
    """
    count = len(genes)
    weights = generator.standard_normal((len(parents), count)) * (width / np.sqrt(count))
    children = np.abs(parents + weights @ (genes - np.mean(genes, axis=0)))
    return np.asarray(1.0 - np.abs(1.0 - np.clip(children, 0.0, 2.0)))


def draw_winners(objectives: FloatArray, generator: Generator) -> NDArray[np.int64]:
    """Return the better one of two drawn at random, P times: indices (P,)."""
    first, second = generator.integers(len(objectives), size=(2, len(objectives)))
    return np.asarray(np.where(objectives[first] <= objectives[second], first, second))


def choose_survivors(
    genes: FloatArray, objectives: FloatArray, children: FloatArray, reached: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the best P of parents and children, the best first, and their objectives."""
    both, values = np.vstack([genes, children]), np.concatenate([objectives, reached])
    kept = np.argsort(values, kind="stable")[: len(genes)]
    return both[kept], values[kept]


def search_by_population(
    problem: FrictionProblem, options: GeneticOptions, generator: Generator
) -> FrictionSearch:
    """Return the best candidate of the genetic algorithm, or of its hybrid with annealing."""
    box = UnitBoxProblem(problem)
    genes = generator.random((options.population * box.size, box.size))
    objectives = box.compute_objectives(genes)
    box.history.append(float(np.min(objectives)))
    temperature, converged = float(np.max(objectives)) - box.history[0], False
    while not converged and len(box.history) <= options.generations:
        parents = genes[draw_winners(objectives, generator)]
        children = draw_children(genes, parents, options.width, generator)
        genes, objectives = choose_survivors(genes, objectives, children, box.compute_objectives(children))
        if options.step > 0.0:
            neighbours = draw_children(genes, genes, options.step, generator)
            reached = box.compute_objectives(neighbours)
            rise = reached - objectives
            chance = np.exp(-np.maximum(rise, 0.0) / max(temperature, 1e-300))
            accepted = generator.random(len(genes)) < chance
            # Survivors stand in order: the first is the best.
            accepted[0] = rise[0] < 0.0
            genes = np.where(accepted[:, None], neighbours, genes)
            objectives = np.where(accepted, reached, objectives)
            temperature *= options.cooling
        box.history.append(float(np.min(objectives)))
        converged = compute_spread(objectives) <= options.tolerance
    best = int(np.argmin(objectives))
    return box.build_search(
        options,
        genes[best],
        float(objectives[best]),
        converged=converged,
        population=len(genes),
        width=options.width,
        **({"cooling": options.cooling} if options.step > 0.0 else {}),
    )


def search_by_evolution(
    problem: FrictionProblem, options: EvolutionOptions, generator: np.random.Generator
) -> FrictionSearch:
    """Return the best candidate of differential evolution."""
    from scipy.optimize import differential_evolution

    box = UnitBoxProblem(problem)

    def compute_objectives(genes: FloatArray) -> FloatArray:
        objectives = box.compute_objectives(np.atleast_2d(genes.T))
        box.history.append(min(*box.history[-1:], float(np.min(objectives)), np.inf))
        return objectives

    answer = differential_evolution(
        compute_objectives,
        [(0.0, 1.0)] * box.size,
        maxiter=options.generations,
        popsize=options.population,
        tol=options.tolerance,
        seed=generator,
        # With SciPy's own defaults, best1bin and 0.7, 4 of 40 draws failed.
        strategy="randtobest1bin",
        recombination=0.9,
        polish=False,
        vectorized=True,
        updating="deferred",
    )
    return box.build_search(
        options,
        answer.x,
        float(answer.fun),
        converged=bool(answer.success),
        population=options.population * box.size,
        strategy="randtobest1bin",
    )
