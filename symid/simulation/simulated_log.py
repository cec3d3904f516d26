"""A simulated log: an experiment of a rigid or of an elastic robot, logged like a real one.

Robot whose file states all values, its library, ReferenceMotion, SensorSettings -> SimulatedLog.

Supported: sensors with one standard deviation for all joints; `experiment` and `elastic_experiment` take
others.
"""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace

import numpy as np

from symid.codegen import Library
from symid.errors import Notice, RobotError, UsageError
from symid.excitation import ReferenceMotion
from symid.joint_models import NO_FRICTION
from symid.logs import Recording
from symid.options import SimulateOptions
from symid.robot import Coupling, Joint, Robot
from symid.simulation.elastic_experiment import (
    MotorGains,
    build_clean_options,
    build_noisy_options,
    simulate_elastic,
)
from symid.simulation.elastic_plant import refuse_rigid_joints
from symid.simulation.experiment import PERIOD, ExperimentOptions, SensorOptions, simulate_experiment

DEFAULT_NOISE = 0.05
"""N m or N, of rigid robots; elastic ones have noise in proportion to their torques."""


def check_control_options(control: SimulateOptions) -> None:
    """Refuse, by a UsageError, gains that are negative or not finite, and those of one kind alone."""
    texts = []
    if (control.stiffness is None) != (control.damping is None):
        texts.append("give --stiffness and --damping together, one number for each joint")
    if control.bandwidth is not None and control.stiffness is not None:
        texts.append("--bandwidth is that of gains that follow from the inertia; give it or the gains")
    for name in ("stiffness", "damping"):
        values = getattr(control, name) or ()
        if not all(0.0 <= value < np.inf for value in values):
            texts.append(f"--{name}: expected finite numbers of 0 or more, got {values}")
    if texts:
        raise UsageError(*(Notice(code="usage.gains", text=text) for text in texts))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SimulatedLog:
    """A log, and how it came about.

    Args:
        recording: what the sensors read.
        energy_gap: how far work, energy and losses disagree, relative to the work.
        backend: what computed the motion.
        details: in plain types: the noise, the controller of a rigid robot, the torsion of an elastic one.
    """

    recording: Recording
    energy_gap: float
    backend: str
    details: Mapping[str, object]


def check_sensor_options(robot: Robot, sensors: SimulateOptions) -> None:
    """Refuse, by a UsageError, a delay or an offset between encoders for a robot without elastic joints."""
    if not any(robot.elastic) and (sensors.delay or sensors.offset):
        text = (
            f"--delay and --offset are between motor and link encoders, and {robot.name} has no elastic "
            "joint; leave them out"
        )
        raise UsageError(Notice(code="usage.rigid-sensors", text=text))


def simulate_log(
    robot: Robot,
    library: Library,
    motion: ReferenceMotion,
    options: SimulateOptions,
    rng: np.random.Generator,
) -> SimulatedLog:
    """Return the log of a robot with all values under PD control along `motion`; `rng` is of the noise."""
    check_control_options(options)
    stiffness = None if options.stiffness is None else tuple(map(float, options.stiffness))
    damping = None if options.damping is None else tuple(map(float, options.damping))
    period = options.control_period
    if not any(robot.elastic):
        noise = DEFAULT_NOISE if options.noise is None else options.noise
        one = SensorOptions(counts_per_turn=None) if options.clean else SensorOptions(torque_noise=(noise,))
        order = ExperimentOptions(
            sensors=one,
            controller=robot.controller,
            bandwidth=options.bandwidth,
            period=period or PERIOD,
            stiffness=stiffness,
            damping=damping,
        )
        rigid = simulate_experiment(robot, library, motion, order, rng)
        return SimulatedLog(
            recording=rigid.recording,
            energy_gap=rigid.energy_gap,
            backend=rigid.backend,
            details={"noise": 0.0 if options.clean else noise, "controller": asdict(rigid.controller)},
        )
    setup = build_clean_options() if options.clean else build_noisy_options()
    setup = replace(setup, bandwidth=options.bandwidth, period=period or setup.period)
    if stiffness is not None and damping is not None:
        setup = replace(setup, gains=MotorGains(stiffness=stiffness, damping=damping))
    both = replace(setup.sensors, delay=options.delay, link_offset=(options.offset,))
    if options.noise is not None and not options.clean:
        both = replace(both, torque_noise=(options.noise,), relative_noise=(0.0,))
    elastic = simulate_elastic(robot, library, motion, replace(setup, sensors=both), rng)
    return SimulatedLog(
        recording=elastic.recording,
        energy_gap=elastic.relative_gap,
        backend=elastic.backend,
        details={
            "noise": both.torque_noise[0],
            "relative_noise": both.relative_noise[0],
            "delay": options.delay,
            "offset": options.offset,
            "largest_torsion": abs(elastic.phi).max(axis=0).tolist(),
        },
    )


def _list_gaps(part: Joint | Coupling) -> Iterator[str]:
    """Yield the values that a joint or a coupling does not state."""
    if isinstance(part, Coupling):
        if part.has_rotor and part.rotor_inertia is None:
            yield "the rotor_inertia"
    else:
        if part.inertial is None:
            yield "[joint.link] mass, com and inertia"
        if part.drive.has_rotor and part.drive.rotor_inertia is None:
            yield "the rotor_inertia of [joint.drive]"
        if part.spring is not None and None in (part.spring.stiffness, part.spring.rest):
            yield "stiffness and rest of [joint.spring]"
        if part.elasticity is not None and part.elasticity.initial_stiffness is None:
            yield "the stiffness of [joint.elasticity] and of its stops"
        if part.elasticity is not None and not part.drive.has_rotor:
            yield "the rotor_inertia of [joint.drive], which an elastic joint needs"
    if part.friction.law != NO_FRICTION and part.friction.values is None:
        yield f"the values of friction {part.friction.law}"


def check_stated_values(robot: Robot) -> None:
    """Refuse a robot that cannot be simulated before minutes go into its derivation.

    Raises:
        RobotError: its file lacks values.
        UsageError: only some of its joints are elastic.
    """
    if any(robot.elastic):
        refuse_rigid_joints(robot)
    lacking = [f"joint '{joint.name}': {gap}" for joint in robot.joints for gap in _list_gaps(joint)]
    lacking += [f"coupling '{one.name}': {gap}" for one in robot.couplings for gap in _list_gaps(one)]
    if lacking:
        text = f"cannot be simulated, these values are not stated: {'; '.join(lacking)}"
        raise RobotError(Notice(code="robot.no-values", text=text, file=robot.path))
