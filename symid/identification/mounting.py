"""Identification of a rigid robot whose gravity, or zeros of joints, are found with its parameters.

Robot with `free_gravity` or `free_zeros`, recordings -> an `Estimate`, and the robot as it is mounted.

    tau = Y(q + z; g) beta + Yf f      linear in beta and f for given gravity g and zeros z

    directions that motions show -> fit at (g, z) -> fit with the tangents d tau / d (g, z) -> step -> ...

These are steps of Gauss and Newton (variable projection, Golub and Pereyra 1973), halved where they do not
help. In the last fit, where no step is left, gravity and zeros have deviations as all other parameters have.
The search starts at the direction of gravity, and at the zeros, that thinned logs say. The size of gravity
stays that of the robot file unless it surely is another one: few motions show it well.

What no motion shows is the rank of the problem: columns of the model at random states, with random base
parameters, against the tangents. It is left as it is: the size of gravity, parts of it as 0, zeros as stated.

Supported: all rows, estimators that fit equations, several logs, joints that others follow.
Not supported: known payloads, estimators that simulate, priors, a search of friction laws at the same time;
elastic joints.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from symid import dynamics
from symid.arrays import FloatArray
from symid.codegen import Library, ParameterCard
from symid.errors import IdentifiabilityError, Notice, UsageError
from symid.identification import diagnostics, regression, rigid as rigids
from symid.identification.estimators import Estimate, ParameterEstimate
from symid.identification.judge import POLICY, numerics
from symid.identification.options import IdentifyOptions
from symid.joint_models import REFERENCE_TEMPERATURE
from symid.logs import Recording, refuse_known_payloads
from symid.notation import GRAVITY_SYMBOLS, MOUNTING
from symid.robot import DEFAULT_GRAVITY, Robot, mount_robot

_EARTH = np.array([value.to_float() for value in DEFAULT_GRAVITY])
_EARTH_SPREAD = 1.5e-3
"""Deviation of a size that is only stated, part of it: 9.780 m/s^2 at the equator, 9.832 at the poles."""
_STATES = 200
"""Random ones, at which the rank of the problem is found."""
_STEP = 1e-3
"""rad or m, of differences of fourth order: their error is that of rounding."""
_GRID = 8
"""Zeros in a turn that are tried first."""
_LARGEST = 0.5
"""Of a step: rad or m, and part of the size of gravity."""


class _Seen(NamedTuple):
    """What motions show: `directions` (3 + z, k), and whether the size of gravity.

    `hidden` (h, 3) are axes along which gravity shows nowhere; `told` says what does not show, in words.
    """

    directions: FloatArray
    size: bool
    hidden: FloatArray
    told: tuple[str, ...]


class _MountedFit(NamedTuple):
    """A fit at gravity and zeros `where` (3 + z,): functions with tangents along `directions` (3 + z, k).

    `left` is what the fit without these leaves, in percent.
    """

    where: FloatArray
    robot: Robot
    library: Library
    directions: FloatArray
    seen: _Seen
    estimate: Estimate
    plan: rigids.FitPlan
    left: float

    def measure(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return gravity and zeros (m,) found, their covariance, and how parameters (p,) move them (m, p)."""
        names, values = [entry.name for entry in self.estimate.parameters], self.where.copy()
        rows = np.zeros((len(values), len(names)))
        for card, direction in zip(self.library.card.searched, self.directions.T, strict=True):
            # Logs may show less than motions can.
            if card.name in names:
                place = names.index(card.name)
                rows[:, place] = direction
                values += direction * (self.estimate.parameters[place].value - (card.value or 0.0))
        return values, rows @ np.array(self.estimate.covariance) @ rows.T, rows

    def find_step(self) -> FloatArray:
        """Return the step (3 + z,) that is left, of bounded size; zero where it matters no more."""
        values, covariance, _ = self.measure()
        step, deviations = values - self.where, np.sqrt(np.maximum(np.diag(covariance), 0.0))
        scales = np.ones(len(step))
        scales[:3] = np.linalg.norm(self.where[:3]) or 1.0
        if np.all(np.abs(step) <= np.maximum(POLICY.relevance * deviations, numerics.CONVERGED * scales)):
            return np.zeros(len(step))
        return step / max(1.0, float(np.max(np.abs(step) / scales)) / _LARGEST)


class _Problem(NamedTuple):
    """The robot as stated, its recordings, what compiles it, and options of `identify_parameters`."""

    robot: Robot
    recordings: Sequence[Recording]
    prepare: Callable[[Robot], Library]
    given: IdentifyOptions
    options: dict[str, Any]

    def mount(self, where: FloatArray) -> Robot:
        zeros = dict(zip(self.robot.free_zeros, where[3:].tolist(), strict=True))
        return mount_robot(self.robot, where[:3].tolist() if self.robot.free_gravity else (), zeros)

    def fit(self, robot: Robot, library: Library, plan: rigids.FitPlan) -> Estimate:
        """Return the fit with the functions of a mounted robot."""
        logs, estimator = self.recordings, self.options["estimator"]
        more = rigids.build_estimator_options(robot, library, logs, estimator, self.given)
        settings = {**self.options, "plan": plan, "robot": robot, "options": more}
        return rigids.identify_parameters(library, logs, robot.processing, **settings)

    def evaluate_tangents(
        self, robot: Robot, library: Library, beta: FloatArray, *states: FloatArray
    ) -> FloatArray:
        """Return the changes (N, n, 3 + z) of torque with gravity and zeros, at q, dq and ddq (N, n)."""
        q, dq, ddq = (np.ascontiguousarray(part) for part in states)
        columns = np.zeros((*q.shape, 3 + len(self.robot.free_zeros)))
        labels = dynamics.derive_base_parameters(robot).keys
        if self.robot.free_gravity:
            weighed = [(link, name) for link in range(robot.size) for name in dynamics.WEIGHED]
            known = dict(zip(labels, beta.tolist(), strict=True))
            mass = np.array([known.get(label, 0.0) for label in weighed])
            columns[..., :3] = np.moveaxis(dynamics.evaluate_weight_columns(robot, q) @ mass, 0, 2)
        # The rest of a spring is a reading of the encoder.
        turned = np.where([name in {"KS", "KR"} for _, name in labels], 0.0, beta)
        names = [joint.name for joint in robot.axes]
        for place, name in enumerate(self.robot.free_zeros, start=3):
            unit = _STEP * np.eye(q.shape[1])[names.index(name)]
            ahead, behind, further, back = (
                library.evaluate("inverse_dynamics", q + size * unit, dq, ddq, turned)[0]
                for size in (1.0, -1.0, 2.0, -2.0)
            )
            columns[..., place] = (8.0 * (ahead - behind) - (further - back)) / (12.0 * _STEP)
        return columns

    def find_seen(self, robot: Robot, library: Library, where: FloatArray) -> _Seen:
        """Return what motions of the mounted robot show of gravity and zeros."""
        rng = np.random.default_rng(0)
        q, dq, ddq, load, warmth = rng.normal(size=(5, _STATES, len(robot.axes)))
        q, warmth = 2.0 * q, warmth + REFERENCE_TEMPERATURE
        columns = regression.evaluate_columns(library, q, dq, ddq, load, warmth)
        beta = rng.normal(size=len(library.card.beta))
        tangents = self.evaluate_tangents(robot, library, beta, q, dq, ddq)
        basis, rest = _span(columns.reshape(-1, columns.shape[2])), tangents.reshape(-1, tangents.shape[2])
        least = numerics.CONVERGED * max(float(np.linalg.norm(rest, axis=0).max()), numerics.TINY)
        told, size, seen, hidden = list[str](), False, np.zeros((0, 3)), np.zeros((0, 3))
        if self.robot.free_gravity:
            left = rest[:, :3] - basis @ (basis.T @ rest[:, :3])
            _, sizes, axes = np.linalg.svd(left, full_matrices=False)
            own = where[:3] / np.linalg.norm(where[:3])
            seen, hidden = _align(axes[sizes > least]), _align(axes[sizes <= least])
            size = float(np.linalg.norm(left @ own)) > least
            if not size:
                told.append("the magnitude of gravity, which parameters absorb; it stays as stated")
                hidden = _align(_span((hidden - np.outer(hidden @ own, own)).T).T)
            told += [f"gravity along {_write(axis)}; 0 is taken" for axis in hidden]
            basis = _span(np.column_stack([basis, rest[:, :3] @ seen.T]))
        directions = [*np.pad(seen, ((0, 0), (0, len(self.robot.free_zeros))))]
        for place, name in enumerate(self.robot.free_zeros, start=3):
            column = rest[:, place]
            if np.linalg.norm(column - basis @ (basis.T @ column)) > least:
                directions.append(np.eye(rest.shape[1])[place])
                basis = _span(np.column_stack([basis, column]))
            else:
                told.append(
                    f"the zero of joint {name!r}, which gravity or parameters absorb; it stays as stated"
                )
        if not directions:
            text = "; ".join(
                f"not identifiable from any motion of {self.robot.name!r}: {entry}" for entry in told
            )
            text += ". State gravity and zeros in the robot file"
            raise IdentifiabilityError(Notice(code="identify.no-mounting", text=text))
        return _Seen(np.array(directions).T, size, hidden, tuple(told))

    def list_starts(self, library: Library, plan: rigids.FitPlan, where: FloatArray) -> list[FloatArray]:
        """Return gravity, and zeros on a grid, that thinned logs say: (3 + z,), one or several."""
        robot, study, starts, size = self.mount(where), plan.study, [where], np.linalg.norm(where[:3])
        if study is None:
            return starts
        if self.robot.free_gravity:
            logs = diagnostics.FollowedLogs.follow(library, study.logs.motion, study.logs.fold)
            found = np.append(diagnostics.estimate_gravity(logs, robot).direction, where[3:])
            hidden = self.find_seen(robot, library, found).hidden
            # Zeros that are off may look like gravity, up to its sign.
            starts = [found, where, -found] if self.robot.free_zeros else [found]
            for start in starts:
                start[:3] -= hidden.T @ (hidden @ start[:3])
            starts = [start for start in starts if np.linalg.norm(start[:3]) > numerics.CONVERGED]
            for start in starts:
                start[:3] *= size / np.linalg.norm(start[:3])
        return [self.search_zeros(start, study.logs) for start in starts] if self.robot.free_zeros else starts

    def search_zeros(self, where: FloatArray, logs: regression.CondensedLogs) -> FloatArray:
        """Return zeros on a grid, joint by joint, with which a model under gravity leaves least."""
        robot, motion, found = self.mount(where), logs.motion, where.copy()
        library, names = self.prepare(robot), [joint.name for joint in robot.axes]
        seen = np.any(self.find_seen(robot, library, where).directions, axis=1).tolist()
        turns = 2.0 * np.pi * np.arange(_GRID) / _GRID
        for place, name in enumerate(self.robot.free_zeros, start=3):
            number = names.index(name)
            if not seen[place] or robot.axes[number].prismatic:
                continue
            moved = [replace(motion, q=motion.q + turn * np.eye(len(names))[number]) for turn in turns]
            pairs = [(diagnostics.evaluate_motion(library, one), one) for one in moved]
            left = np.array([diagnostics.fit_motion(*pair, logs.fold).squares.sum() for pair in pairs])
            best = int(left.argmin())
            if left[best] < (1.0 - POLICY.relevance) * left[0]:
                found[place] = (turns[best] + np.pi) % (2.0 * np.pi) - np.pi
                motion = moved[best]
        return found

    def fit_at(self, where: FloatArray, plan: rigids.FitPlan, *, size: bool, choose: bool) -> _MountedFit:
        """Return the fit at gravity and zeros (3 + z,), with or without the `size` of gravity as an unknown.

        `choose`: whether the plan is chosen anew, for rows with tangents.
        """
        robot = self.mount(where)
        library = self.prepare(robot)
        seen = self.find_seen(robot, library, where)
        directions, cards = seen.directions, []
        if seen.size and not size:
            # Without the direction that changes the size of gravity.
            own, turns = where[:3] / np.linalg.norm(where[:3]), directions[:3].any(axis=0)
            across = _span(directions[:3, turns] - np.outer(own, own @ directions[:3, turns]))
            kept = np.pad(_align(across.T).T, ((0, len(directions) - 3), (0, 0)))
            directions = np.column_stack([kept, directions[:, ~turns]])
        for direction in directions.T:
            name, unit = f"gravity along {_write(direction[:3])}", "m/s^2"
            if not direction[:3].any():
                name, unit = _name_zero(robot, self.robot.free_zeros[int(direction.argmax()) - 3])
            entry = ParameterCard(name=name, expression=name, unit=unit, reason=MOUNTING, joint="")
            cards.append(replace(entry, value=float(direction @ where)))
        card = replace(library.card, searched=tuple(cards))

        def widen(beta: FloatArray) -> Library:
            def evaluate(q: FloatArray, dq: FloatArray, ddq: FloatArray) -> FloatArray:
                return self.evaluate_tangents(robot, library, beta, q, dq, ddq) @ directions

            return Library(card, library.engine, library.notices, evaluate)

        names = [entry.name for entry in library.card.beta]
        plain = self.fit(robot, library, replace(plan, study=None))
        # The model has fewer parameters where a part of gravity is zero.
        if choose or (plan.study is not None and len(plan.study.fit.values) != len(card.fitted)):
            settings = {name: self.options[name] for name in ("rows", "estimator")}
            plan = rigids.plan_fit(
                widen(plain.assemble(names)), self.recordings, robot.processing, **settings
            )
            plain = self.fit(robot, library, replace(plan, study=None))
        wide = widen(plain.assemble(names))
        found = self.fit(robot, wide, replace(plan, study=None))
        return _MountedFit(where, robot, wide, directions, seen, found, plan, plain.mean_relative_percent)

    def settle(self, where: FloatArray, plan: rigids.FitPlan, *, size: bool, choose: bool) -> _MountedFit:
        """Return the fit at which no step is left; arguments as for `fit_at`."""
        best = self.fit_at(where, plan, size=size, choose=choose)
        step, least = best.find_step(), best.left
        for _ in range(numerics.ROUNDS):
            if not step.any():
                break
            moved = best.where + step
            if self.robot.free_gravity and not (size and best.seen.size):
                moved[:3] *= np.linalg.norm(where[:3]) / np.linalg.norm(moved[:3])
            fitted = self.fit_at(moved, best.plan, size=size, choose=False)
            if fitted.left > (1.0 + POLICY.relevance) * least:
                step = step / 2.0
                continue
            best, least = fitted, min(fitted.left, least)
            step = best.find_step()
        return best

    def finish(self, found: _MountedFit) -> _MountedFit:
        """Return a fit with evidence, and with deviations that blocks of the logs widen."""
        return found._replace(estimate=self.fit(found.robot, found.library, found.plan))


def refuse_mounting(where: str) -> UsageError:
    """Return the error that gravity or zeros cannot be found `where` something else is done."""
    text = f"gravity or zeros cannot be found {where}; state them in the robot file, or leave that out"
    return UsageError(Notice(code="usage.mounting", text=text))


def search_mounting(
    robot: Robot,
    recordings: Sequence[Recording],
    prepare: Callable[[Robot], Library],
    given: IdentifyOptions,
    *,
    progress: Callable[[str], None] = lambda _: None,
    **options: Any,  # noqa: ANN401 - those of `identify_parameters` from `rows` on
) -> tuple[Estimate, Library]:
    """Return the estimate with gravity and zeros found, and the functions of the robot mounted so.

    `prepare` returns the compiled functions of a robot. An IdentifiabilityError where no motion shows any of
    what is to be found; else errors as of `identify_parameters`.
    """
    if given.friction is not None:
        raise refuse_mounting(where="where friction laws are found as well")
    if given.prior is not None or given.estimator in {"ridge", *rigids.SIMULATING}:
        raise refuse_mounting(where="with a prior, or by estimators that simulate")
    refuse_known_payloads(recordings, "a search of gravity or zeros")
    progress("finding gravity and zeros" if robot.free_zeros else "finding gravity")
    problem = _Problem(robot, recordings, prepare, given, options)
    before = np.array([value.to_float(dict(robot.symbols)) for value in robot.gravity])
    before = before if before.any() or not robot.free_gravity else _EARTH
    where = np.append(before, np.zeros(len(robot.free_zeros)))
    # A first search along torque rows.
    library = prepare(problem.mount(where))
    plan = rigids.plan_fit(library, recordings, robot.processing, rows="torque", estimator=None)
    plain = problem._replace(options={**options, "rows": "torque", "estimator": None, "window": None})
    starts, plan = plain.list_starts(library, plan, where), replace(plan, study=None)
    ends = (plain.settle(start, plan, size=False, choose=False) for start in starts)
    where = min(ends, key=lambda end: end.left).where
    found, size_found = problem.settle(where, plan, size=False, choose=True), ""
    if robot.free_gravity and found.seen.size:
        free = problem.finish(problem.fit_at(found.where, plan, size=True, choose=True))
        size, deviation = _measure_size(*free.measure()[:2])
        size_found = f"{size:.5g} +- {deviation:.2g}"
        if abs(size - np.linalg.norm(before)) > POLICY.printed * deviation:
            # What is held out is that of the first plan, which began elsewhere: it is chosen once more.
            where, size_found = problem.settle(free.where, free.plan, size=True, choose=False).where, ""
            found = problem.settle(where, plan, size=True, choose=True)
    found = problem.finish(found)
    if (upright := _stand_upright(found)) is not None:
        found = problem.finish(problem.fit_at(upright, found.plan, size=not size_found, choose=True))
    return _record(problem, found, before, size_found), found.library


def _stand_upright(found: _MountedFit) -> FloatArray | None:
    """Return gravity along a first axis that turns, and zeros (3 + z,), where nothing speaks against it.

    Under such a gravity the model has fewer parameters: near it, products with a small part of gravity.
    """
    base = next(joint for joint in found.robot.joints if joint.parent < 0)
    axis = np.array([row[2].to_float() for row in base.placement.rotation])
    values, covariance, _ = found.measure()
    along, across = axis * (axis @ values[:3]), np.linalg.svd(axis[None])[2][1:]
    off, spread = across @ values[:3], across @ covariance[:3, :3] @ across.T
    if base.prismatic or not along.any() or not np.diag(spread).all():
        return None
    if off @ np.linalg.solve(spread, off) > POLICY.printed**2:
        return None
    along[np.abs(along) <= numerics.EXACT * np.abs(along).max()] = 0.0
    return np.append(along, found.where[3:])


def _record(problem: _Problem, found: _MountedFit, before: FloatArray, told: str) -> Estimate:
    """Return the estimate with gravity and zeros as its parameters, and what it says of them.

    `before` (3,) is the gravity of the robot file, `told` the size that was found where that is taken.
    """
    estimate, robot, zeros = found.estimate, found.robot, problem.robot.free_zeros
    values, covariance, rows = found.measure()
    place, turn, said = np.zeros_like(values), "", list[str]()
    if problem.robot.free_gravity:
        turn, text = _describe_gravity(values, covariance, before, told)
        said.append(text)
        size, deviation = _measure_size(values, covariance)
        if deviation <= numerics.CONVERGED * size:
            # A size that was not found may be that of another place.
            place[:3] = _EARTH_SPREAD * values[:3]
    covariance = covariance + np.outer(place, place)
    deviations = np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist()
    units = [*((name, "m/s^2") for name in GRAVITY_SYMBOLS), *(_name_zero(robot, name) for name in zeros)]
    shown = np.flatnonzero(found.directions.any(axis=1)).tolist()
    own = [
        ParameterEstimate(units[k][0], values[k].item(), deviations[k], units[k][1], units[k][0], MOUNTING)
        for k in shown
    ]
    cards = [card.name for card in found.library.card.searched]
    kept = [k for k, entry in enumerate(estimate.parameters) if entry.name not in cards]
    whole = np.vstack([np.eye(len(estimate.parameters))[kept], rows[shown]])
    wider = whole @ np.array(estimate.covariance) @ whole.T
    wider[len(kept) :, len(kept) :] += np.outer(place[shown], place[shown])
    offsets = {joint.name: "0" for joint in robot.axes}
    for k in (k for k in shown if k > 2):
        name, (_, unit) = zeros[k - 3], units[k]
        offsets[name] = f"{values[k]:.6g}"
        said.append(
            f"zero of {name}: {values[k]:.5g} +- {deviations[k]:.2g} {unit} are added to its readings"
        )
    if any(text != "0" for text in offsets.values()):
        said.append(f"to keep zeros, write offset = [{', '.join(offsets.values())}] below [log.position]")
    mounting = {
        "gravity": found.where[:3].tolist() if problem.robot.free_gravity else [],
        "zeros": dict(zip(zeros, found.where[3:].tolist(), strict=True)),
        "names": [*(name for name, _ in units), *cards],
        "turn": turn,
        "said": said,
    }
    notices = [
        Notice(code="identify.mounting", text=f"not identifiable from these motions: {entry}")
        for entry in found.seen.told
    ]
    return replace(
        estimate,
        parameters=(*(estimate.parameters[k] for k in kept), *own),
        covariance=tuple(map(tuple, wider.tolist())),
        settings={**estimate.settings, "mounting": mounting},
        notices=(*estimate.notices, *notices),
    )


def _describe_gravity(
    values: FloatArray, covariance: FloatArray, before: FloatArray, told: str
) -> tuple[str, str]:
    """Return how far gravity is turned from `before` (3,), with its deviation, and all of it, in words."""
    length, deviation = _measure_size(values, covariance)
    own, old = values[:3] / length, before / np.linalg.norm(before)
    # The turn changes by what moves gravity away from the old direction, across the new one; by any part
    # across, where they are one, or opposite, or motions do not show that.
    across, away = np.eye(3) - np.outer(own, own), own * (own @ old) - old
    apart = float(np.linalg.norm(away))
    angle = np.degrees(np.arctan2(apart, own @ old))
    spread = away @ covariance[:3, :3] @ away / apart**2 if apart > numerics.CONVERGED else 0.0
    spread = spread or max(float(np.linalg.eigvalsh(across @ covariance[:3, :3] @ across)[-1]), 0.0)
    size = f"its magnitude is {length:.5g} +- {deviation:.2g} m/s^2"
    if told or deviation <= numerics.CONVERGED * length:
        told = f"found as {told}" if told else "not identifiable from these motions"
        size = f"its magnitude, {told}, is taken as {length:.5g} m/s^2"
    turn = f"gravity is turned by {angle:.4g} +- {np.degrees(np.sqrt(spread)) / length:.2g} degrees"
    line = ", ".join(f"{value:.5g}" for value in values[:3])
    return turn, f"{turn} from ({_write(before)}); {size}. To keep it, write gravity = [{line}]"


def _measure_size(values: FloatArray, covariance: FloatArray) -> tuple[float, float]:
    """Return the size of gravity and its deviation, of gravity and zeros (m,) with their covariance."""
    size = float(np.linalg.norm(values[:3]))
    own = values[:3] / size
    return size, float(np.sqrt(max(float(own @ covariance[:3, :3] @ own), 0.0)))


def _name_zero(robot: Robot, name: str) -> tuple[str, str]:
    place, joint = next((k, joint) for k, joint in enumerate(robot.joints, start=1) if joint.name == name)
    return f"zero{place}", "m" if joint.prismatic else "rad"


def _span(matrix: FloatArray) -> FloatArray:
    """Return an orthonormal basis (m, r) of the columns of a matrix (m, p), each of which counts alike."""
    lengths = np.linalg.norm(matrix, axis=0)
    left, sizes, _ = np.linalg.svd(matrix[:, lengths > 0.0] / lengths[lengths > 0.0], full_matrices=False)
    return np.asarray(left[:, sizes > numerics.CONVERGED * sizes.max(initial=0.0)])


def _align(axes: FloatArray) -> FloatArray:
    """Return an orthonormal basis (k, 3) of the span of `axes` (k, 3): axes of the base where these do."""
    off = np.linalg.norm(axes.T @ axes - np.eye(3), axis=0)
    inside = np.eye(3)[off < numerics.CONVERGED]
    return inside if len(inside) == len(axes) else axes


def _write(vector: FloatArray) -> str:
    return ", ".join(f"{value:.3g}" for value in vector + 0.0)
