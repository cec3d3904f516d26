"""`symid simulate ROBOT -o LOG`: an experiment on the computer, logged like a real one."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from symid.cli.inputs import check_output, load_robot, load_robot_library, show_path
from symid.cli.options import FiniteRange, force_option, friction_option, output_option, seed_option, verb
from symid.cli.output import Answer, Console
from symid.cli.stated_values import check_values
from symid.errors import Notice, OutputError, UsageError

if TYPE_CHECKING:  # these load numpy
    import numpy as np

    from symid.codegen.library import Library
    from symid.data.recording import Recording
    from symid.excitation.motion import Motion
    from symid.excitation.trajectories import Trajectory
    from symid.robot.description import Robot
    from symid.simulation.elastic_options import ElasticExperimentOptions
    from symid.simulation.experiment import ExperimentOptions

__all__ = ["build_options", "build_trajectory", "command"]

DEFAULT_NOISE = 0.05
"""N m or N, of rigid robots; elastic ones have noise in proportion to their torques."""
_TA_JOINTS = 2
_SUFFIXES = (".npz", ".csv")
_TRAJECTORIES = ("fourier", "ta", "tb", "tc")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sensors:
    """What the command line says of sensors; `noise` None for the default of the kind of robot."""

    clean: bool
    noise: float | None
    delay: float
    offset: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Outcome:
    """A log, the energy gap relative to the work, what computed it, results that only some robots have."""

    recording: "Recording"
    energy_gap: float
    backend: str
    result: dict[str, object]


@click.command("simulate")
@click.argument("robot")
@click.option(
    "--trajectory",
    metavar="NAME|FILE",
    default="fourier",
    show_default=True,
    help="fourier, a random Fourier series; ta or tb, published ones; tc, kept for validation; or a file of "
    "symid excite, .csv.",
)
@click.option(
    "--scale",
    type=FiniteRange(min=0.0, min_open=True),
    default=1.0,
    show_default=True,
    metavar="FACTOR",
    help="Of the trajectory's amplitudes.",
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
    metavar="N",
    help=f"Standard deviation of the torque sensors, N m or N.  [default: {DEFAULT_NOISE}; of an elastic "
    "robot 2 % of each joint's RMS torque]",
)
@click.option("--clean", is_flag=True, help="Perfect sensors: no noise, no encoder steps.")
@click.option(
    "--delay",
    type=FiniteRange(),
    default=0.0,
    metavar="S",
    help="Of an elastic robot: by how much its link encoders are later than its motor encoders.",
)
@click.option(
    "--offset",
    type=FiniteRange(),
    default=0.0,
    metavar="RAD",
    help="Of an elastic robot: what its link encoders read at zero.",
)
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
    scale: float,
    duration: float | None,
    noise: float | None,
    clean: bool,
    delay: float,
    offset: float,
    friction: str | None,
    seed: int,
    output: Path,
    force: bool,
) -> Answer:
    """Move the robot under PD control along a trajectory and write what its sensors see.

    The robot file must state masses and friction. Elastic robots are moved by their motors; their log holds
    link positions q, motor positions theta and motor torques tau.
    """
    described = load_robot(robot, friction=friction)
    sensors = _Sensors(clean=clean, noise=noise, delay=delay, offset=offset)
    _check_suffix(output)
    check_output(output, force=force, inputs=(described.path, *_list_files(trajectory)))
    _check_sensors(described, sensors)
    check_values(described)
    import numpy as np

    from symid.data.writers import write_recording

    rng = np.random.default_rng(seed)
    path = _find_motion(described, trajectory, rng, duration=duration, joint=joint, scale=scale)
    library = load_robot_library(described, console)
    console.progress(f"simulating {path.duration:g} s of {described.name}")
    simulate = _simulate_elastic if any(described.elastic) else _simulate_rigid
    outcome = simulate(described, library, path, sensors, rng)
    recording = outcome.recording
    written = write_recording(recording, output, described)
    result = {
        "robot": described.name,
        "file": written,
        "trajectory": path.source,
        "samples": len(recording.time),
        "period": recording.period,
        "duration": path.duration,
        "seed": seed,
        "energy_gap": outcome.energy_gap,
        "backend": outcome.backend,
        **outcome.result,
    }
    text = (
        f"{show_path(written)}: {len(recording.time)} samples of {path.source}; "
        f"work, energy and losses agree to {outcome.energy_gap:.1e} of the work"
    )
    warnings = (*described.notices, *library.notices, *recording.notices)
    return Answer(text=text, result=result, warnings=warnings)


def _simulate_rigid(
    robot: "Robot",
    library: "Library",
    trajectory: "Motion",
    sensors: _Sensors,
    rng: "np.random.Generator",
) -> _Outcome:
    from symid.simulation.experiment import simulate_experiment

    noise = DEFAULT_NOISE if sensors.noise is None else sensors.noise
    options = replace(build_options(noise, clean=sensors.clean), controller=robot.controller)
    run = simulate_experiment(robot, library, trajectory, options, rng)
    return _Outcome(
        recording=run.recording,
        energy_gap=run.energy_gap,
        backend=library.backend,
        result={"noise": 0.0 if sensors.clean else noise, "controller": asdict(run.controller)},
    )


def _simulate_elastic(
    robot: "Robot",
    library: "Library",
    trajectory: "Motion",
    sensors: _Sensors,
    rng: "np.random.Generator",
) -> _Outcome:
    from symid.simulation.elastic_experiment import simulate_elastic

    options = _build_elastic_options(sensors)
    run = simulate_elastic(robot, library, trajectory, options, rng)
    noise = options.sensors.torque_noise[0]
    return _Outcome(
        recording=run.recording,
        energy_gap=run.relative_gap,
        backend=run.backend,
        result={
            "noise": noise,
            "relative_noise": options.sensors.relative_noise[0],
            "delay": sensors.delay,
            "offset": sensors.offset,
            "largest_torsion": abs(run.phi).max(axis=0).tolist(),
        },
    )


def _build_elastic_options(sensors: _Sensors) -> "ElasticExperimentOptions":
    from symid.simulation.elastic_options import build_clean_options, build_noisy_options

    options = build_clean_options() if sensors.clean else build_noisy_options()
    seen = replace(options.sensors, delay=sensors.delay, link_offset=(sensors.offset,))
    if sensors.noise is not None and not sensors.clean:
        seen = replace(seen, torque_noise=(sensors.noise,), relative_noise=(0.0,))
    return replace(options, sensors=seen)


def _check_sensors(robot: "Robot", sensors: _Sensors) -> None:
    if not any(robot.elastic) and (sensors.delay or sensors.offset):
        text = (
            f"--delay and --offset are between the encoders of motors and links; {robot.name} has no elastic "
            "joint; leave them out"
        )
        raise UsageError(Notice(code="usage.rigid-sensors", text=text))


def _list_files(name: str) -> tuple[Path, ...]:
    """Return the file that a trajectory is read from, nothing for those with names."""
    if name in _TRAJECTORIES:
        return ()
    if not Path(name).is_file():
        known = ", ".join(_TRAJECTORIES)
        text = f"--trajectory {name}: neither one of {known} nor a file; symid excite writes one"
        raise UsageError(Notice(code="usage.trajectory", text=text))
    return (Path(name),)


def _find_motion(
    robot: "Robot",
    name: str,
    rng: "np.random.Generator",
    *,
    duration: float | None,
    joint: int,
    scale: float,
) -> "Motion":
    """Return the trajectory of a name, or that of a file, of which no more than `duration` s is kept."""
    from symid.excitation.motion import build_part, build_scaled_samples
    from symid.excitation.trajectory_file import read_trajectory

    if name in _TRAJECTORIES:
        return build_trajectory(robot, name, rng, duration=duration, joint=joint, scale=scale)
    motion = build_scaled_samples(read_trajectory(Path(name), robot), scale)
    if duration is None:
        return motion
    if duration > motion.duration:
        text = f"--duration {duration:g} s: the trajectory ends after {motion.duration:g} s"
        raise UsageError(Notice(code="usage.trajectory", text=text, file=name))
    return build_part(motion, duration)


def _check_suffix(path: Path) -> None:
    if path.suffix.lower() not in _SUFFIXES:
        text = f"a log is written as {' or '.join(_SUFFIXES)}, got {path.suffix or 'no suffix'}"
        raise OutputError(Notice(code="output.unknown-suffix", text=text, file=str(path)))


def build_options(noise: float, *, clean: bool) -> "ExperimentOptions":
    """Return how the experiment is run: with sensors as they are, or perfect ones."""
    from symid.simulation.experiment import ExperimentOptions
    from symid.simulation.sensors import SensorOptions

    if clean:
        return ExperimentOptions(sensors=SensorOptions(counts_per_turn=None))
    return ExperimentOptions(sensors=SensorOptions(torque_noise=(noise,)))


def build_trajectory(
    robot: "Robot",
    name: str,
    rng: "np.random.Generator",
    *,
    duration: float | None = None,
    joint: int = 1,
    scale: float = 1.0,
) -> "Trajectory":
    """Return the trajectory called `name`, "fourier", "ta", "tb" or "tc", its amplitudes times `scale`.

    Raises:
        UsageError: "ta" is for another number of joints, or "tb" for a joint that is not there.
    """
    from symid.excitation.trajectories import build_scaled

    return build_scaled(_build_unscaled(robot, name, rng, duration=duration, joint=joint), scale)


def _build_unscaled(
    robot: "Robot", name: str, rng: "np.random.Generator", *, duration: float | None, joint: int
) -> "Trajectory":
    from symid.excitation.trajectories import (
        FourierOptions,
        build_random_fourier,
        build_ta,
        build_tb,
        build_tc,
    )

    if name == "fourier":
        options = FourierOptions() if duration is None else FourierOptions(duration=duration)
        return build_random_fourier(robot, rng, options)
    length = {} if duration is None else {"duration": duration}
    if name == "tb":
        return build_tb(joint - 1, size=robot.freedom, **length)
    if name == "tc":
        return build_tc(size=robot.freedom, **length)
    if robot.freedom != _TA_JOINTS:
        text = f"trajectory ta moves {_TA_JOINTS} joints, {robot.name} has {robot.freedom}; use fourier"
        raise UsageError(Notice(code="usage.trajectory", text=text))
    return build_ta(**length)
