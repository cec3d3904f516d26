"""`symid simulate ROBOT -o LOG`: an experiment on the computer, logged like a real one."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from symid.cli.inputs import check_output, load_robot, load_robot_library, show_path
from symid.cli.options import FiniteRange, force_option, friction_option, output_option, seed_option, verb
from symid.cli.output import Answer, Console
from symid.errors import Notice, OutputError, RobotError, UsageError

if TYPE_CHECKING:  # these load numpy
    import numpy as np

    from symid.excitation.trajectories import Trajectory
    from symid.robot.description import Coupling, FrictionValues, Joint, Robot
    from symid.simulation.experiment import ExperimentOptions

__all__ = ["build_options", "build_trajectory", "command"]

DEFAULT_NOISE = 0.05
_TA_JOINTS = 2
_SUFFIXES = (".npz", ".csv")


@click.command("simulate")
@click.argument("robot")
@click.option(
    "--trajectory",
    type=click.Choice(("fourier", "ta", "tb")),
    default="fourier",
    show_default=True,
    help="A random Fourier series, or one of the published trajectories.",
)
@click.option(
    "--joint",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Joint that tb moves; those that follow another do not count.",
)
@click.option("--duration", type=FiniteRange(min=0.0, min_open=True), metavar="S", help="Length in s.")
@click.option(
    "--noise",
    type=FiniteRange(min=0.0),
    default=DEFAULT_NOISE,
    show_default=True,
    metavar="N",
    help="Standard deviation of the torque sensors, N m or N.",
)
@click.option("--clean", is_flag=True, help="Perfect sensors: no noise, no encoder steps.")
@friction_option
@seed_option
@output_option("Log to write, .npz or .csv.", required=True)
@force_option
@verb
def command(
    console: Console,
    *,
    robot: str,
    trajectory: str,
    joint: int,
    duration: float | None,
    noise: float,
    clean: bool,
    friction: str | None,
    seed: int,
    output: Path,
    force: bool,
) -> Answer:
    """Move the robot under PD control along a trajectory and write what its sensors see.

    The robot file must state masses and friction.
    """
    described = load_robot(robot, friction=friction)
    _check_suffix(output)
    check_output(output, force=force, inputs=(described.path,))
    _check_values(described)
    import numpy as np

    from symid.data.writers import write_recording
    from symid.simulation.experiment import simulate_experiment

    rng = np.random.default_rng(seed)
    path = build_trajectory(described, trajectory, rng, duration=duration, joint=joint)
    library = load_robot_library(described, console)
    console.progress(f"simulating {path.duration:g} s of {described.name}")
    run = simulate_experiment(described, library, path, build_options(noise, clean=clean), rng)
    written = write_recording(run.recording, output, described)
    result = {
        "robot": described.name,
        "file": written,
        "trajectory": path.source,
        "samples": len(run.recording.time),
        "period": run.recording.period,
        "duration": path.duration,
        "seed": seed,
        "noise": 0.0 if clean else noise,
        "energy_gap": run.energy_gap,
        "backend": library.backend,
    }
    text = (
        f"{show_path(written)}: {len(run.recording.time)} samples of {path.source}; "
        f"work, energy and losses agree to {run.energy_gap:.1e} of the work"
    )
    warnings = (*described.notices, *library.notices, *run.recording.notices)
    return Answer(text=text, result=result, warnings=warnings)


def _check_suffix(path: Path) -> None:
    if path.suffix.lower() not in _SUFFIXES:
        text = f"a log is written as {' or '.join(_SUFFIXES)}, got {path.suffix or 'no suffix'}"
        raise OutputError(Notice(code="output.unknown-suffix", text=text, file=str(path)))


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
    yield from _list_friction_gap(joint.friction)


def _list_coupling_gaps(coupling: "Coupling") -> Iterator[str]:
    if coupling.has_rotor and coupling.rotor_inertia is None:
        yield "the rotor_inertia"
    yield from _list_friction_gap(coupling.friction)


def _check_values(robot: "Robot") -> None:
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


def build_options(noise: float, *, clean: bool) -> "ExperimentOptions":
    """Return how the experiment is run: with sensors as they are, or perfect ones."""
    from symid.simulation.experiment import ExperimentOptions
    from symid.simulation.sensors import SensorOptions

    if clean:
        return ExperimentOptions(sensors=SensorOptions(counts_per_turn=None))
    return ExperimentOptions(sensors=SensorOptions(torque_noise=(noise,)))


def build_trajectory(
    robot: "Robot", name: str, rng: "np.random.Generator", *, duration: float | None = None, joint: int = 1
) -> "Trajectory":
    """Return the trajectory called `name`, "fourier", "ta" or "tb".

    Raises:
        UsageError: "ta" is for another number of joints, or "tb" for a joint that is not there.
    """
    from symid.excitation.trajectories import FourierOptions, build_random_fourier, build_ta, build_tb

    if name == "fourier":
        options = FourierOptions() if duration is None else FourierOptions(duration=duration)
        return build_random_fourier(robot, rng, options)
    length = {} if duration is None else {"duration": duration}
    if name == "tb":
        return build_tb(joint - 1, size=robot.freedom, **length)
    if robot.freedom != _TA_JOINTS:
        text = f"trajectory ta moves {_TA_JOINTS} joints, {robot.name} has {robot.freedom}; use fourier"
        raise UsageError(Notice(code="usage.trajectory", text=text))
    return build_ta(**length)
