"""What elastic models predict of a log, and how well links follow a motion under a model's feed-forward.

    motor    F[tau_J] = F[tau] - IA F[ddtheta] - F[Yf] f
    link     F[tau_J] = F[M ddq + C dq + g]
    spring   F[tau_J] = F[spring(theta - q)]
    elastic feed-forward  tau_J = inverse dynamics of the links, theta = q + H^-1[tau_J],
                          tau = IA ddtheta + F(dtheta) + tau_J
    rigid feed-forward    theta = q, tau = inverse dynamics of the links + IA ddq + F(dq)

Torques and torsion pass the same filter F, so that no loop comes from it. The closed loop is simulated with
the truth; runs differ by the feed-forward alone, the generated function `elastic_inverse_dynamics`.

Supported: springs with memory, which begins empty with the log; fits without a spring; several models.
Not supported: one encoder only; noise in the loop; springs that the generated function does not support.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from symid.arrays import FloatArray, FrozenArrays
from symid.codegen import Library, build_spring_vector, prepare_library
from symid.errors import EstimateError, Notice, UsageError
from symid.excitation import ReferenceMotion
from symid.identification.elastic import regression
from symid.identification.elastic.estimate import ElasticEstimate, MethodFit
from symid.identification.elastic.options import ElasticOptions
from symid.identification.estimators import Residual
from symid.identification.hysteresis import filter_smooth
from symid.joint_models import Elasticity, Knee, Stop
from symid.logs import Recording, measure_overlap
from symid.robot import Robot
from symid.simulation import ExperimentOptions, MotorReference, simulate_elastic

_FILTERS = ("stops", "rate", "cutoff")
"""Options that signals and rows of a log depend on."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointTrial(FrozenArrays):
    """One joint: torsion and joint torque by several ways, all filtered alike.

    Args:
        time: (M,) s; torsion: (M,) rad or m.
        motor: (M,) joint torque by the motor equation; link: (M,) by the link equation, N m or N.
        final: (M,) by the identified spring, None where there is none; initial: by the spring of the start.
        truth: (M,) by the true spring, None where it is not known.
    """

    joint: str
    unit: str
    torsion_unit: str
    time: FloatArray
    torsion: FloatArray
    motor: FloatArray
    link: FloatArray
    final: FloatArray | None = None
    initial: FloatArray | None = None
    truth: FloatArray | None = None

    @property
    def straight(self) -> float:
        """Return the stiffness of the linear spring that explains this log best, N m/rad or N/m."""
        scale = float(self.torsion @ self.torsion)
        return float(self.torsion @ self.motor) / scale if scale else 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElasticTrial:
    """One log under the models; `residuals` are tables of residuals, each with its caption.

    `joints` are the elastic ones; `fitted` marks a log of the fit, which is no test.
    """

    source: str
    joints: tuple[JointTrial, ...]
    residuals: tuple[tuple[str, tuple[Residual, ...]], ...]
    fitted: bool = False

    @property
    def mean_relative_percent(self) -> float:
        """Return the mean over joints of what dynamics of motors and links leave, in percent."""
        return self.means[0]

    @property
    def means(self) -> tuple[float, ...]:
        """Return the mean over joints of the relative residuals of every table, in percent."""
        tables = ([entry.relative_percent for entry in entries] for _, entries in self.residuals)
        return tuple(float(np.mean(percents)) for percents in tables)


def evaluate_elastic(
    estimate: ElasticEstimate,
    library: Library,
    recording: Recording,
    *,
    initial: Sequence[Elasticity] = (),
    cutoff: float | None = None,
) -> ElasticTrial:
    """Return what `estimate`, of the library's model, predicts of `recording`, filtered as its own logs were.

    `initial` are the springs of the start, one a joint, empty where they are not at hand; `cutoff` is that of
    the low-pass in Hz in place of the estimate's, 0 for none, None to keep that.

    Raises:
        EstimateError: the estimate's settings cannot be used.
        LogError: the recording lacks an encoder, or is too short.
    """
    found: dict[str, Any] = {name: estimate.settings[name] for name in _FILTERS if name in estimate.settings}
    if cutoff is not None:
        found["cutoff"] = cutoff
    try:
        options = ElasticOptions(**found)
    except (TypeError, UsageError) as error:
        text = f"its settings cannot be used: {error}; identify again"
        raise EstimateError(Notice(code="estimate.settings", text=text)) from error
    final, source = estimate.build_fit(library.card), recording
    (recording,) = regression.fill_motor_loads(library, [recording], final.beta)
    signals = regression.prepare_elastic_signals(recording, options, estimate.effects)
    rows = regression.build_filtered_rows(library, signals, options.filter_rate)
    motor, link = rows.compute_motor_side(final.chi), rows.compute_link_side(final.chi)
    torsion = filter_smooth(signals.phi, options.filter_rate, signals.period)[rows.keep]

    def pass_spring(spring: Elasticity | None, joint: int) -> FloatArray | None:
        if spring is None or spring.initial_stiffness is None:
            return None
        return rows.pass_spring(spring, signals, joint, options.filter_rate)

    known = {spring.joint: spring.elasticity for spring in estimate.springs if spring.identifiable}
    truth = {spring.joint: spring.truth for spring in estimate.springs}
    joints = tuple(
        JointTrial(
            joint=card.name,
            unit=card.torque_unit,
            torsion_unit=card.position_unit,
            time=signals.time[rows.keep],
            torsion=torsion[:, joint],
            motor=motor[:, joint],
            link=link[:, joint],
            final=pass_spring(known.get(card.name), joint),
            initial=pass_spring(initial[joint] if initial else None, joint),
            truth=pass_spring(truth.get(card.name), joint),
        )
        for joint, card in enumerate(library.card.joints)
        if library.card.yielding[joint]
    )

    def measure(joint: str, unit: str, errors: FloatArray, measured: FloatArray) -> Residual:
        return Residual.measure(joint, errors, measured, unit, float(np.std(errors)))

    cards = library.card.joints
    torques = dict(zip((card.name for card in cards), rows.torque.T, strict=True))
    pairs = zip(cards, (motor - link).T, strict=True)
    both = [measure(card.name, card.torque_unit, error, torques[card.name]) for card, error in pairs]
    tables = [
        ("Torque of the motors by the dynamics of motors and links together, without springs.", tuple(both))
    ]
    sprung = [(entry, torques[entry.joint], entry.final) for entry in joints if entry.final is not None]
    if sprung:
        motors = (measure(one.joint, one.unit, one.motor - own, torque) for one, torque, own in sprung)
        links = (measure(one.joint, one.unit, one.link - own, one.link) for one, _, own in sprung)
        tables += [
            ("Torque of the motors by their own dynamics and the springs.", tuple(motors)),
            ("Torque of the joints: by the dynamics of the links, less that of the springs.", tuple(links)),
        ]
    fitted = measure_overlap(source, estimate.sources, estimate.settings) > 0.0
    return ElasticTrial(source=recording.source, joints=joints, residuals=tuple(tables), fitted=fitted)


_FUNCTION = "elastic_inverse_dynamics"


def compute_elastic_reference(
    library: Library, fit: MethodFit, trajectory: ReferenceMotion, time: FloatArray
) -> MotorReference:
    """Return angle, speed and torque of the motors under which the links follow `trajectory`.

    The library's robot has springs with as many stops and knees as those of `fit`, the model of the
    controller; `time` (N,) s are the control ticks.

    Raises:
        UsageError: the library has no such function, or springs of another size.
    """
    spec = next((function for function in library.card.functions if function.name == _FUNCTION), None)
    if spec is None:
        text = f"robot {library.card.robot!r} has no function {_FUNCTION}: all its joints must be elastic "
        text += "and driven by motors with a rotor_inertia, without damping, cubic springs or couplings"
        raise UsageError(Notice(code="usage.no-feed-forward", text=text))
    springs = build_spring_vector(fit.elasticity, library.card)
    shared = {"beta": fit.beta, "IA": fit.rotor, "f": fit.friction, "h": springs}
    parameters = [shared[port.name] for port in spec.inputs if port.name in shared]
    remembers = any(port.name == "Q" for port in spec.inputs)
    memory = np.zeros(sum(len(spring.stops) for spring in fit.elasticity))
    call = library.bind(_FUNCTION)
    torque, angle, speed = found = np.empty((3, len(time), library.card.size))
    for tick, state in enumerate(np.stack(trajectory.evaluate(time, 4), axis=1)):
        outputs = call(*state, *parameters, *([memory] if remembers else []))
        found[:, tick] = outputs[:3]
        if remembers:
            memory = outputs[3].copy()
    return MotorReference(angle=angle, speed=speed, torque=torque)


RIGID = "rigid feed-forward"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackingRun(FrozenArrays):
    """One run: time (N,) s, error (N, n) reached less desired position of the links, rad or m."""

    name: str
    time: FloatArray
    error: FloatArray

    @property
    def rms(self) -> FloatArray:
        """Return the root mean square error of each joint (n,), rad or m."""
        return np.asarray(np.sqrt(np.mean(self.error**2, axis=0)))

    @property
    def peak(self) -> FloatArray:
        """Return the largest error of each joint (n,), rad or m."""
        return np.asarray(np.max(np.abs(self.error), axis=0))


def simulate_tracking(
    robot: Robot,
    library: Library,
    models: Mapping[str, MethodFit],
    trajectory: ReferenceMotion,
    options: ExperimentOptions,
    *,
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[TrackingRun, ...]:
    """Return a run of the true robot for every model, and first one with rigid feed-forward.

    `models` are what controllers believe, by name, at least one: the rigid feed-forward takes inertias and
    friction of the first; `progress` is called before work that takes a while.

    Raises:
        UsageError, SolverError: see `simulate_elastic` and `compute_elastic_reference`.
    """
    duration = trajectory.duration if options.duration is None else options.duration
    time: FloatArray = np.arange(round(duration / options.period) + 1) * np.float64(options.period)
    first = next(iter(models.values()))
    # Rigid feed-forward takes the motors to be where the links are.
    q, dq, ddq = trajectory.evaluate(time)
    torque = library.evaluate("inverse_dynamics", q, dq, ddq, first.beta)[0] + first.rotor * ddq
    if library.card.friction:
        given = library.card.gather_friction_inputs(dq, q=q, load=torque)
        torque = torque + library.evaluate("friction", *given, first.friction)[0]
    references = {RIGID: MotorReference(angle=q, speed=dq, torque=torque)}
    counts = list(map(_count, zip(*(fit.elasticity for fit in models.values()), strict=True)))
    # The numbers of the springs are arguments of the function.
    plain = widen_springs([Elasticity(stiffness=1.0)] * len(counts), counts)
    joints = list(robot.joints)
    for index, spring in zip(robot.coordinates, plain, strict=True):
        joints[index] = replace(joints[index], elasticity=spring)
    shaped = replace(robot, joints=tuple(joints))
    controller = prepare_library(shaped, names=(_FUNCTION,), progress=progress, backend=library.backend)
    for name, fit in models.items():
        wide = replace(fit, elasticity=widen_springs(fit.elasticity, counts))
        references[name] = compute_elastic_reference(controller, wide, trajectory, time)
    # No noise is drawn for the loop; the logs of these runs are not used.
    runs, rng = [], np.random.default_rng(0)
    for name, reference in references.items():
        found = simulate_elastic(robot, library, trajectory, options, rng, reference=reference)
        runs.append(TrackingRun(name=name, time=found.recording.time, error=found.q - found.desired))
    return tuple(runs)


def _count(springs: Sequence[Elasticity]) -> tuple[int, int, int]:
    """Return the most stops, knees below and above zero of springs, as powers of two: many share code."""
    numbers = [
        (len(spring.stops), below, len(spring.knees) - below)
        for spring in springs
        for below in [sum(knee.threshold < 0.0 for knee in spring.knees)]
    ]
    most = np.max(numbers, axis=0).tolist()
    stops, below, above = (1 << (count - 1).bit_length() if count else 0 for count in most)
    return stops, below, above


def widen_springs(
    elasticity: Sequence[Elasticity], counts: Sequence[Sequence[int]]
) -> tuple[Elasticity, ...]:
    """Return springs of the same torque with more stops and knees, which have no effect."""

    def extend(places: list[float], least: int, first: float) -> list[float]:
        last = places[-1] if places else first
        return [last * 2.0**step for step in range(1, least - len(places) + 1)]

    wide = []
    for spring, (count, below, above) in zip(elasticity, counts, strict=True):
        radii = extend([stop.threshold for stop in spring.stops], count, 1.0)
        places = sorted(knee.threshold for knee in spring.knees)
        further = extend([place for place in places[::-1] if place < 0.0], below, -1.0)
        further += extend([place for place in places if place > 0.0], above, 1.0)
        stops = (*spring.stops, *(Stop(threshold=place, stiffness=0.0) for place in radii))
        knees = [*spring.knees, *(Knee(threshold=place, slope=0.0) for place in further)]
        wide.append(replace(spring, stops=stops, knees=tuple(sorted(knees))))
    return tuple(wide)
