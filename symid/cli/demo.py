"""`symid demo`: the whole path on a two-link arm, from the robot file to the report."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from symid.cli.inputs import describe_origin, load_robot, load_robot_library, show_path
from symid.cli.options import force_folder_option, output_option, verb
from symid.cli.output import Answer, Console
from symid.cli.simulate import build_trajectory
from symid.cli.tables import describe_estimate, describe_validation, show_parameters, show_residual
from symid.errors import Notice, OutputError

if TYPE_CHECKING:  # these load numpy
    import numpy as np

    from symid.codegen.library import Library
    from symid.data.recording import Recording
    from symid.identification.estimate import Estimate, Validation
    from symid.robot.description import Robot

__all__ = ["command"]

_ROBOT = "two_link"
_DURATION = 20.0
_NOISE = 0.2
"""Of the torque sensors, N m: about one percent of what the shoulder needs."""
_FACTOR = 1.15
"""How far the held-out residual may lie above the noise: what the filters blur at reversals adds to it."""
_SEED = 0
_OURS = frozenset({"code", "training.npz", "validation.npz", "estimate.json", "report.html"})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Experiment:
    """Two runs of one robot along different trajectories."""

    robot: "Robot"
    library: "Library"
    training: "Recording"
    validation: "Recording"


@click.command("demo")
@click.option(
    "--seed", type=click.IntRange(min=0), default=_SEED, show_default=True, help="Of all random numbers."
)
@output_option("Folder for code, logs, estimate and report.", folder=True)
@force_folder_option
@verb
def command(console: Console, *, seed: int, output: Path | None, force: bool) -> Answer:
    """Simulate a two-link arm, generate its code, identify it, validate on another motion, report.

    Exit code 1 when a true value lies beyond 3 standard deviations or the residual
    more than 15 % above the noise, the allowance for what the filters blur.
    """
    folder = output or Path("demo")
    _prepare_folder(folder, force=force)
    robot = load_robot(_ROBOT)
    from symid.report.identification import write_report

    files = _generate(robot, folder / "code", console)
    experiment = _simulate(robot, folder, seed, console)
    estimate, validation = _identify(experiment, folder, console)
    read = (*robot.notices, *experiment.library.notices)
    read += (*experiment.training.notices, *experiment.validation.notices)
    origin = describe_origin(robot, experiment.library, (experiment.training, experiment.validation))
    console.progress("writing the report")
    report = write_report(folder / "report.html", estimate, (validation,), read, origin)
    noise = _find_noise(robot, seed)
    errors = _judge(estimate, validation, noise)
    text = [
        f"{robot.name}: parameters identified from {show_path(folder / 'training.npz')}",
        show_parameters(estimate),
        f"residual on {show_path(folder / 'validation.npz')}, another trajectory; {_describe_limit(noise)}",
        show_residual(validation.residual),
        f"{len(files)} files of C in {show_path(folder / 'code')}, compiled, self-test passed"
        if experiment.library.backend == "c"
        else f"{len(files)} files of C in {show_path(folder / 'code')}, not compiled: no C compiler",
        f"report: {report.resolve()}",
    ]
    result = {
        "estimate": describe_estimate(estimate),
        "validation": describe_validation(validation),
        "noise": noise,
        "seed": seed,
        "backend": experiment.library.backend,
        "code": folder / "code",
        "report": report,
    }
    warnings = (*read, *estimate.notices, *validation.notices)
    return Answer(
        text="\n\n".join(text), result=result, warnings=warnings, errors=errors, exit_code=1 if errors else 0
    )


def _prepare_folder(folder: Path, *, force: bool) -> None:
    """Make the folder; refuse one with files of others, and with --force take one of an earlier demo."""
    if folder.is_file():
        text = "is a file, not a folder; give the name of a folder"
        raise OutputError(Notice(code="output.not-a-folder", text=text, file=str(folder)))
    found = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    if found and (found - _OURS or not force):
        text = "is not empty; give another folder with -o"
        if not found - _OURS:
            text += ", or --force to write over the last demo"
        raise OutputError(Notice(code="output.foreign-folder", text=text, file=str(folder)))
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        text = f"cannot be made: {error.strerror}"
        raise OutputError(Notice(code="output.cannot-write", text=text, file=str(folder))) from error


def _generate(robot: "Robot", folder: Path, console: Console) -> tuple[Path, ...]:
    """Robot -> Functions -> SourceSet -> files, and the folder's own test of them."""
    from symid.cli.generate import run_selftest
    from symid.codegen.c_library import generate_c_library
    from symid.codegen.casadi_functions import build_functions
    from symid.codegen.writer import write_sources

    console.progress(f"deriving the dynamics of {robot.name} and writing C")
    files = write_sources(generate_c_library(build_functions(robot)), folder, force=True)
    run_selftest(folder, "c", console)
    return files


def _simulate(robot: "Robot", folder: Path, seed: int, console: Console) -> _Experiment:
    """Robot, Library -> two logs, written and read again like those of a real robot."""
    import numpy as np

    from symid.data.readers import read_recording

    library = load_robot_library(robot, console)
    rng = np.random.default_rng(seed)
    paths = [
        _run_once(robot, library, folder / f"{name}.npz", rng, console) for name in ("training", "validation")
    ]
    training, validation = (read_recording(path, robot) for path in paths)
    return _Experiment(robot=robot, library=library, training=training, validation=validation)


def _run_once(
    robot: "Robot", library: "Library", path: Path, rng: "np.random.Generator", console: Console
) -> Path:
    from symid.data.writers import write_recording
    from symid.simulation.experiment import ExperimentOptions, simulate_experiment
    from symid.simulation.sensors import SensorOptions

    console.progress(f"simulating {_DURATION:g} s for {path.name}")
    trajectory = build_trajectory(robot, "fourier", rng, duration=_DURATION)
    sensors = SensorOptions(torque_noise=(_NOISE,))
    options = ExperimentOptions(sensors=sensors)
    run = simulate_experiment(robot, library, trajectory, options, rng)
    return write_recording(run.recording, path, robot)


def _identify(experiment: _Experiment, folder: Path, console: Console) -> "tuple[Estimate, Validation]":
    """Recordings -> Estimate on one of them, Validation on the other."""
    from symid.identification.identify import identify_parameters
    from symid.identification.storage import write_estimate
    from symid.identification.validate import validate_estimate

    console.progress("identifying, and validating on the other trajectory")
    library, processing = experiment.library, experiment.robot.processing
    estimate = identify_parameters(library, (experiment.training,), processing)
    write_estimate(estimate, folder / "estimate.json")
    return estimate, validate_estimate(estimate, library, experiment.validation, processing)


def _find_noise(robot: "Robot", seed: int) -> float:
    """Return the standard deviation in N m that white sensor noise has after decimation."""
    import numpy as np

    from symid.data.signals import decimate_columns

    white = np.random.default_rng(seed).normal(scale=_NOISE, size=(20_000, 1))
    return float(decimate_columns(white, robot.processing.decimation).std())


def _describe_limit(noise: float) -> str:
    margin = 100.0 * (_FACTOR - 1.0)
    return f"noise {noise:.3g} N m, limit {_FACTOR * noise:.3g} N m ({margin:.0f} % above it)"


def _judge(estimate: "Estimate", validation: "Validation", noise: float) -> tuple[Notice, ...]:
    """Return what a demo must not end with."""
    far = [
        entry.name
        for entry in estimate.parameters
        if entry.truth is not None and abs(entry.value - entry.truth) > 3.0 * entry.std
    ]
    loud = [entry.joint for entry in validation.residual if entry.std > _FACTOR * noise]
    notices = []
    if far:
        text = f"more than 3 standard deviations from the truth: {', '.join(far)}"
        notices.append(Notice(code="demo.off-truth", text=text))
    if loud:
        text = f"residual above the limit: joint {', '.join(loud)}; {_describe_limit(noise)}"
        notices.append(Notice(code="demo.above-noise", text=text))
    return tuple(notices)
