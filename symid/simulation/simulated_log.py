"""A simulated log: an experiment of a rigid or of an elastic robot, logged like a real one.

Robot whose file states all values, its library, ReferenceMotion, SensorSettings -> SimulatedLog.
`check_stated_values` names everything that a robot file lacks, before minutes go into a derivation.

Supported: sensors with one deviation for all joints; `experiment` and `elastic_experiment` take others.
"""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from symid.codegen import Library
from symid.errors import Notice, RobotError, UsageError
from symid.excitation import ReferenceMotion
from symid.logs import Recording
from symid.robot import Robot
from symid.simulation.elastic_experiment import (
    build_clean_options,
    build_noisy_options,
    simulate_elastic,
)
from symid.simulation.experiment import ExperimentOptions, simulate_experiment
from symid.simulation.sensors import SensorOptions

if TYPE_CHECKING:
    from symid.robot import Coupling, FrictionValues, Joint

DEFAULT_NOISE = 0.05
"""N m or N, of rigid robots; elastic ones have noise in proportion to their torques."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorSettings:
    """How the sensors are.

    Args:
        clean: whether they are perfect: no noise, no encoder steps.
        noise: standard deviation of the torque, N m or N; None for the default of the kind of robot.
        delay: of an elastic robot: by how much its link encoders are later than its motor encoders, s.
        offset: of an elastic robot: what its link encoders read at zero, rad or m.
    """

    clean: bool = False
    noise: float | None = None
    delay: float = 0.0
    offset: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SimulatedLog:
    """A log, and how it came about.

    Args:
        recording: what the sensors saw.
        energy_gap: how far work, energy and losses disagree, relative to the work.
        backend: what computed the motion.
        details: in plain types: the noise, the controller of a rigid robot, the torsion of an elastic one.
    """

    recording: Recording
    energy_gap: float
    backend: str
    details: Mapping[str, object]


def check_sensor_settings(robot: Robot, sensors: SensorSettings) -> None:
    """Refuse encoders of an elastic robot for one that has no elastic joint.

    Raises:
        UsageError: they were given.
    """
    if not any(robot.elastic) and (sensors.delay or sensors.offset):
        text = (
            f"--delay and --offset are between the encoders of motors and links; {robot.name} has no elastic "
            "joint; leave them out"
        )
        raise UsageError(Notice(code="usage.rigid-sensors", text=text))


def simulate_log(
    robot: Robot, library: Library, motion: ReferenceMotion, sensors: SensorSettings, rng: np.random.Generator
) -> SimulatedLog:
    """Return the log of a robot under PD control along a trajectory.

    Args:
        robot: with all values; elastic ones are moved by their motors.
        library: its functions.
        motion: the trajectory.
        sensors: how they are.
        rng: of the noise.
    """
    simulate = _simulate_elastic if any(robot.elastic) else _simulate_rigid
    return simulate(robot, library, motion, sensors, rng)


def _simulate_rigid(
    robot: Robot, library: Library, motion: ReferenceMotion, sensors: SensorSettings, rng: np.random.Generator
) -> SimulatedLog:
    noise = DEFAULT_NOISE if sensors.noise is None else sensors.noise
    seen = SensorOptions(counts_per_turn=None) if sensors.clean else SensorOptions(torque_noise=(noise,))
    options = ExperimentOptions(sensors=seen, controller=robot.controller)
    run = simulate_experiment(robot, library, motion, options, rng)
    return SimulatedLog(
        recording=run.recording,
        energy_gap=run.energy_gap,
        backend=library.backend,
        details={"noise": 0.0 if sensors.clean else noise, "controller": asdict(run.controller)},
    )


def _simulate_elastic(
    robot: Robot, library: Library, motion: ReferenceMotion, sensors: SensorSettings, rng: np.random.Generator
) -> SimulatedLog:
    options = build_clean_options() if sensors.clean else build_noisy_options()
    given = replace(options.sensors, delay=sensors.delay, link_offset=(sensors.offset,))
    if sensors.noise is not None and not sensors.clean:
        given = replace(given, torque_noise=(sensors.noise,), relative_noise=(0.0,))
    options = replace(options, sensors=given)
    run = simulate_elastic(robot, library, motion, options, rng)
    return SimulatedLog(
        recording=run.recording,
        energy_gap=run.relative_gap,
        backend=run.backend,
        details={
            "noise": options.sensors.torque_noise[0],
            "relative_noise": options.sensors.relative_noise[0],
            "delay": sensors.delay,
            "offset": sensors.offset,
            "largest_torsion": abs(run.phi).max(axis=0).tolist(),
        },
    )


def _list_friction_gap(friction: "FrictionValues") -> Iterator[str]:
    if friction.kind.value != "none" and friction.values is None:
        yield f"the values of friction {friction.kind.value}"


def _list_joint_gaps(joint: "Joint") -> Iterator[str]:
    if joint.inertial is None:
        yield "[joint.link] mass, com and inertia"
    if joint.drive.has_rotor and joint.drive.rotor_inertia is None:
        yield "the rotor_inertia of [joint.drive]"
    if joint.spring is not None and None in (joint.spring.stiffness, joint.spring.rest):
        yield "stiffness and rest of [joint.spring]"
    if joint.elasticity is not None and joint.elasticity.initial_stiffness is None:
        yield "the stiffness of [joint.elasticity] and of its stops"
    if joint.elasticity is not None and not joint.drive.has_rotor:
        yield "the rotor_inertia of [joint.drive], which an elastic joint needs"
    yield from _list_friction_gap(joint.friction)


def _list_coupling_gaps(coupling: "Coupling") -> Iterator[str]:
    if coupling.has_rotor and coupling.rotor_inertia is None:
        yield "the rotor_inertia"
    yield from _list_friction_gap(coupling.friction)


def check_stated_values(robot: "Robot") -> None:
    """Refuse a robot whose file lacks values, before minutes go into its derivation."""
    lacking = [f"joint '{joint.name}': {gap}" for joint in robot.joints for gap in _list_joint_gaps(joint)]
    lacking += [
        f"coupling '{coupling.name}': {gap}"
        for coupling in robot.couplings
        for gap in _list_coupling_gaps(coupling)
    ]
    if lacking:
        text = f"cannot be simulated, these values are not stated: {'; '.join(lacking)}"
        raise RobotError(Notice(code="robot.no-values", text=text, file=robot.path))
