"""`symid demo`: the main job on a two-link arm with elastic joints, from the robot file to the report."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from symid.cli.elastic_tables import describe_elastic, show_elastic_parameters, show_springs
from symid.cli.export import find_identified, write_identified
from symid.cli.inputs import describe_origin, describe_settings, load_robot, load_robot_library, show_path
from symid.cli.options import force_folder_option, output_option, verb
from symid.cli.output import Answer, Console, format_table
from symid.errors import Notice, OutputError

if TYPE_CHECKING:  # these load numpy
    from symid.codegen.library import Library
    from symid.data.recording import Recording
    from symid.elastic.estimate import ElasticEstimate
    from symid.elastic.tracking import TrackingRun
    from symid.robot.description import Robot
    from symid.simulation.elastic_run import ElasticRun

__all__ = ["command"]

_ROBOT = "two_link_elastic"
_SEED = 0
_TRAINING = ("TA10", "TB1", "TB2")
_HELD_OUT = "TC"
_MOST_PARAMETERS = 2.0
_MOST_HYSTERESIS = 3.0
"""Errors in percent that a demo must not end above."""
_METHODS = ("linear-spring", "two-step", "independent")
_LOGS = {"TA": "ta.npz", "TA10": "ta10.npz", "TB1": "tb1.npz", "TB2": "tb2.npz", "TC": "tc.npz"}
_OURS = frozenset({"code", *_LOGS.values(), "estimate.json", "identified.toml", "report.html"})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Experiment:
    """Runs of the arm with their truth, and the logs of them, read like those of a real robot."""

    robot: "Robot"
    library: "Library"
    runs: Mapping[str, "ElasticRun"]
    logs: Mapping[str, "Recording"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Findings:
    """Estimates by method, the chosen one under "automatic", and their errors in percent."""

    estimates: Mapping[str, "ElasticEstimate"]
    errors: Mapping[str, tuple[float, float]]

    @property
    def best(self) -> "ElasticEstimate":
        """Return the estimate of the automatic choice."""
        return self.estimates["automatic"]


@click.command("demo")
@click.option(
    "--seed", type=click.IntRange(min=0), default=_SEED, show_default=True, help="Of all random numbers."
)
@output_option("Folder for code, logs, estimate and report.", folder=True)
@force_folder_option
@verb
def command(console: Console, *, seed: int, output: Path | None, force: bool) -> Answer:
    """Simulate an arm with elastic joints, identify dynamics and hysteresis, validate, report.

    Exit code 1 when a parameter is more than 2 % or the hysteresis more than 3 % off the truth, or
    when the links follow no better with the identified model than with a rigid one.
    """
    folder = output or Path("demo")
    _prepare_folder(folder, force=force)
    robot = load_robot(_ROBOT)
    files = _generate(robot, folder / "code", console)
    experiment = _simulate(robot, folder, seed, console)
    findings = _identify(experiment, folder, console)
    tracking = _track(experiment, findings, console)
    report = _report(experiment, findings, tracking, folder, console)
    errors = _judge(findings, tracking)
    best = findings.best
    built = "compiled, self-test passed"
    if experiment.library.backend != "c":
        built = "not compiled: no C compiler"
    logs = ", ".join(_LOGS[name] for name in _TRAINING)
    text = [
        f"{robot.name}: dynamics, friction and hysteresis identified from {logs}\n{best.reason}",
        show_elastic_parameters(best),
        show_springs(best),
        _show_errors(findings),
        _show_tracking(tracking, robot),
        f"{len(files)} files of C in {show_path(folder / 'code')}, {built}",
        f"robot file with the identified values: {show_path(folder / 'identified.toml')}",
        f"report: {report.resolve()}",
    ]
    result = {
        "estimate": describe_elastic(best),
        "errors": {
            name: {"parameter_percent": pair[0], "hysteresis_percent": pair[1]}
            for name, pair in findings.errors.items()
        },
        "tracking_rms": {run.name: run.rms.tolist() for run in tracking},
        "seed": seed,
        "backend": experiment.library.backend,
        "code": folder / "code",
        "identified": folder / "identified.toml",
        "report": report,
    }
    warnings = (*experiment.library.notices, *best.notices)
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
    """Robot, Library -> runs, written as logs and read again like those of a real robot."""
    from symid.data.readers import read_recording
    from symid.data.writers import write_recording
    from symid.study.elastic_runs import Condition, observe_runs, simulate_runs

    library = load_robot_library(robot, console)
    console.progress("simulating five experiments with noisy sensors")
    runs = simulate_runs(robot, library, Condition.NOISY)
    logs = {}
    for name, file in _LOGS.items():
        (recording,) = observe_runs(runs, (name,), Condition.NOISY, seed)
        logs[name] = read_recording(write_recording(recording, folder / file, robot), robot)
    return _Experiment(robot=robot, library=library, runs=runs, logs=logs)


def _identify(experiment: _Experiment, folder: Path, console: Console) -> _Findings:
    """Recordings -> estimates, the chosen one written to a file."""
    from symid.elastic.identify import identify_elastic
    from symid.elastic.options import ElasticOptions
    from symid.elastic.storage import write_elastic_estimate
    from symid.study.elastic_errors import find_hysteresis_errors, find_parameter_error, find_truth

    recordings = [experiment.logs[name] for name in _TRAINING]
    truth = find_truth(experiment.library.card)
    echo = describe_settings(experiment.robot)
    estimates, errors = {}, {}
    for method in (*_METHODS, "automatic"):
        console.progress(f"identifying by the method {method!r}")
        options = ElasticOptions(method=method)
        estimate = identify_elastic(experiment.library, recordings, options, echo=echo)
        fit = estimate.build_fit(len(experiment.library.card.beta))
        hysteresis = find_hysteresis_errors(fit, experiment.runs[_HELD_OUT])
        estimates[method] = estimate
        errors[method] = (find_parameter_error(fit, truth), float(hysteresis.max()))
    path = write_elastic_estimate(estimates["automatic"], folder / "estimate.json")
    write_identified(find_identified(_ROBOT, path), path, folder / "identified.toml")
    return _Findings(estimates=estimates, errors=errors)


def _track(experiment: _Experiment, findings: _Findings, console: Console) -> tuple["TrackingRun", ...]:
    """Estimates -> closed loops along the held-out motion with their feed-forward."""
    from symid.elastic.tracking import simulate_tracking
    from symid.excitation.trajectories import build_tc
    from symid.simulation.elastic_options import build_noisy_options

    console.progress("tracking the held-out motion with feed-forward of the identified models")
    bases = len(experiment.library.card.beta)
    models = {
        "Case 1: identified together": findings.best.build_fit(bases),
        "Case 2: identified apart": findings.estimates["independent"].build_fit(bases),
    }
    return simulate_tracking(
        experiment.robot,
        experiment.library,
        models,
        build_tc(),
        build_noisy_options(),
        progress=console.progress,
    )


def _report(
    experiment: _Experiment,
    findings: _Findings,
    tracking: tuple["TrackingRun", ...],
    folder: Path,
    console: Console,
) -> Path:
    from symid.report.elastic import ElasticExtras, write_elastic_report
    from symid.report.elastic_trial import try_estimate
    from symid.report.tracking import Tracking

    console.progress("writing the report")
    library = experiment.library
    initial = [spring.elasticity for spring in findings.estimates["linear-spring"].springs]
    held_out = [experiment.logs[name] for name in (_HELD_OUT, "TA")]
    extras = ElasticExtras(
        trials=tuple(try_estimate(findings.best, library, log, initial=initial) for log in held_out),
        iterated=findings.estimates["two-step"],
        tracking=Tracking(runs=tracking),
        notices=(*experiment.robot.notices, *library.notices),
        origin=describe_origin(experiment.robot, library, tuple(experiment.logs.values())),
    )
    return write_elastic_report(folder / "report.html", findings.best, extras)


def _show_errors(findings: _Findings) -> str:
    rows = [
        [name if name != "automatic" else f"automatic: {findings.best.method}", *pair]
        for name, pair in findings.errors.items()
    ]
    title = (
        "errors against the truth in percent: the largest of all dynamic parameters; the hysteresis of the "
        f"worse joint on {_LOGS[_HELD_OUT]}, a motion that was held out"
    )
    return f"{title}\n\n{format_table(['method', 'parameters', 'hysteresis'], rows)}"


def _show_tracking(tracking: tuple["TrackingRun", ...], robot: "Robot") -> str:
    header = ["feed-forward", *(f"{joint.name}/mrad" for joint in robot.axes)]
    rows = [[run.name, *(1e3 * run.rms).tolist()] for run in tracking]
    title = f"how links follow the motion of {_LOGS[_HELD_OUT]} in closed loop: root mean square errors"
    return f"{title}\n\n{format_table(header, rows)}"


def _judge(findings: _Findings, tracking: tuple["TrackingRun", ...]) -> tuple[Notice, ...]:
    """Return what a demo must not end with."""
    parameters, hysteresis = findings.errors["automatic"]
    notices = []
    if not parameters <= _MOST_PARAMETERS:
        text = f"a parameter is {parameters:.3g} % off the truth; the limit is {_MOST_PARAMETERS:g} %"
        notices.append(Notice(code="demo.off-truth", text=text))
    if not hysteresis <= _MOST_HYSTERESIS:
        text = f"the hysteresis is {hysteresis:.3g} % off the truth; the limit is {_MOST_HYSTERESIS:g} %"
        notices.append(Notice(code="demo.off-spring", text=text))
    rigid, identified = tracking[0], tracking[1]
    if not all(mine < theirs for mine, theirs in zip(identified.rms, rigid.rms, strict=True)):
        text = "the links follow no better with the identified model than with a rigid one"
        notices.append(Notice(code="demo.no-gain", text=text))
    return tuple(notices)
