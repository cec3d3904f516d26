"""How well the links follow a motion when the controller believes in one model or another.

Input: a robot with its truth, models, a trajectory. Output: `TrackingRun` of every model.

The closed loop is simulated with the truth, which the controller does not know; what differs between the runs
is the feed-forward alone.

Supported: several models at once, compared with a controller that takes the joints as rigid.
Not supported: noise in the loop.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.codegen.cache import prepare_library
from symid.codegen.library import Library
from symid.elastic.feed_forward import find_elastic_reference, find_rigid_reference
from symid.elastic.fit import ElasticFit
from symid.excitation.trajectories import Trajectory
from symid.robot.description import Robot
from symid.robot.elasticity import Elasticity, Knee, Stop
from symid.simulation.elastic_experiment import simulate_elastic
from symid.simulation.elastic_options import ElasticExperimentOptions, MotorReference

__all__ = ["RIGID", "SpringCounts", "TrackingRun", "prepare_controller", "simulate_tracking", "widen_springs"]

RIGID = "rigid feed-forward"
_FUNCTION = "elastic_inverse_dynamics"
_FURTHER = 1.5
_MULTIPLE = 4
"""Stops and knees are counted up to it, so that many models share one compiled function."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackingRun:
    """One run: time (N,) s, error (N, n) reached less desired position of the links, rad or m."""

    name: str
    time: FloatArray
    error: FloatArray

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        object.__setattr__(self, "time", freeze(self.time))
        object.__setattr__(self, "error", freeze(self.error))

    @property
    def rms(self) -> FloatArray:
        """Return the root mean square error of each joint (n,), rad or m."""
        result: FloatArray = np.sqrt(np.mean(self.error**2, axis=0))
        return result

    @property
    def peak(self) -> FloatArray:
        """Return the largest error of each joint (n,), rad or m."""
        result: FloatArray = np.max(np.abs(self.error), axis=0)
        return result


@dataclass(frozen=True, slots=True, kw_only=True)
class SpringCounts:
    """How many stops, and knees on either side, the springs of one joint have."""

    stops: int
    below: int
    above: int


def simulate_tracking(
    robot: Robot,
    library: Library,
    models: Mapping[str, ElasticFit],
    trajectory: Trajectory,
    options: ElasticExperimentOptions,
    *,
    rigid: ElasticFit | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[TrackingRun, ...]:
    """Return a run for every model, and first one with rigid feed-forward.

    Args:
        robot: with the true values.
        library: its functions.
        models: what controllers believe, by name.
        trajectory: of the links.
        options: of the closed loop.
        rigid: whose inertias and friction the rigid feed-forward takes; that of the first model by default.
        progress: told of work that takes a while.

    Raises:
        UsageError, SolverError: see `simulate_elastic` and `find_elastic_reference`.
    """
    duration = trajectory.duration if options.duration is None else options.duration
    time: FloatArray = np.arange(round(duration / options.period) + 1) * np.float64(options.period)
    first = rigid or next(iter(models.values()))
    references = {RIGID: find_rigid_reference(library, first, trajectory, time)}
    if models:
        counts = _find_counts([fit.elasticity for fit in models.values()])
        controller = prepare_controller(robot, counts, progress, backend=library.backend)
        for name, fit in models.items():
            wide = replace(fit, elasticity=widen_springs(fit.elasticity, counts))
            references[name] = find_elastic_reference(controller, wide, trajectory, time)
    # No noise is drawn for the loop; the logs of these runs are not used.
    rng = np.random.default_rng(0)

    def run(name: str, reference: MotorReference) -> TrackingRun:
        found = simulate_elastic(robot, library, trajectory, options, rng, reference=reference)
        return TrackingRun(name=name, time=found.time, error=found.q - found.desired)

    return tuple(run(name, reference) for name, reference in references.items())


def prepare_controller(
    robot: Robot,
    counts: Sequence[SpringCounts],
    progress: Callable[[str], None] = lambda _: None,
    *,
    backend: str = "auto",
) -> Library:
    """Return the feed-forward function of a robot whose springs have so many stops and knees.

    Args:
        robot: with elastic joints.
        counts: one a joint.
        progress: told of work that takes a while.
        backend: what computes the function; see `prepare_library`.
    """
    places = dict(zip(robot.coordinates, counts, strict=True))
    joints = tuple(
        replace(joint, elasticity=_build_template(places[index])) if index in places else joint
        for index, joint in enumerate(robot.joints)
    )
    shaped = replace(robot, joints=joints)
    return prepare_library(shaped, names=(_FUNCTION,), progress=progress, backend=backend)


def widen_springs(elasticity: Sequence[Elasticity], counts: Sequence[SpringCounts]) -> tuple[Elasticity, ...]:
    """Return springs of the same torque with more stops and knees, which have no effect."""
    return tuple(_widen(spring, count) for spring, count in zip(elasticity, counts, strict=True))


def _find_counts(models: Sequence[Sequence[Elasticity]]) -> tuple[SpringCounts, ...]:
    """Return, joint by joint, the largest numbers that occur in any model, counted up."""
    return tuple(
        SpringCounts(
            stops=_count_up(len(spring.stops) for spring in springs),
            below=_count_up(sum(knee.threshold < 0.0 for knee in spring.knees) for spring in springs),
            above=_count_up(sum(knee.threshold > 0.0 for knee in spring.knees) for spring in springs),
        )
        for springs in zip(*models, strict=True)
    )


def _count_up(numbers: Iterable[int]) -> int:
    return -(-max(numbers) // _MULTIPLE) * _MULTIPLE


def _widen(spring: Elasticity, count: SpringCounts) -> Elasticity:
    stops = list(spring.stops)
    while len(stops) < count.stops:
        last = stops[-1].threshold if stops else 1.0
        stops.append(Stop(threshold=_FURTHER * last, stiffness=0.0))
    below = [knee for knee in spring.knees if knee.threshold < 0.0]
    above = [knee for knee in spring.knees if knee.threshold > 0.0]
    while len(below) < count.below:
        below.insert(0, Knee(threshold=_FURTHER * below[0].threshold if below else -1.0, slope=0.0))
    while len(above) < count.above:
        above.append(Knee(threshold=_FURTHER * above[-1].threshold if above else 1.0, slope=0.0))
    return replace(spring, stops=tuple(stops), knees=(*below, *above))


def _build_template(count: SpringCounts) -> Elasticity:
    """Return a spring of that shape; its numbers are arguments of the function."""
    return _widen(Elasticity(stiffness=1.0), count)
