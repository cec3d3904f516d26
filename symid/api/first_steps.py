"""First steps: a check of the installation, and a demo: the main job on an arm with elastic joints.

Nothing -> `Doctor`; folder -> `DemoResult`, with code, logs, estimate, robot file and report in the folder.
"""

import contextlib
import os
import platform
import shutil
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, cast, final

from symid import codegen, excitation, identification, logs as log_files, report, simulation, study as studies
from symid.api.fit import ElasticFit, build_dynamics_fit
from symid.api.log import Log, read_log
from symid.api.result import JudgedResult, Progress, Result, ignore
from symid.api.robot import RobotModel, load
from symid.api.robot_files import export_fit
from symid.environment import locate_resource_folder, show_path
from symid.errors import Notice, OutputError, SymidError
from symid.identification import elastic
from symid.options import ExportOptions

if TYPE_CHECKING:
    from symid.report import Block, FitVerdict

_PACKAGES = ("casadi", "click", "filelock", "jinja2", "numpy", "scipy", "sympy")
_OLDEST = (3, 11)


@dataclass(frozen=True, slots=True)
class InstallationFinding:
    """One check.

    Args:
        name: of the item; found: its version or place.
        remedy: what to do; empty if nothing has to be done.
        needed: symid cannot work without it.
    """

    name: str
    found: str
    remedy: str = ""
    needed: bool = True

    def build_notice(self) -> Notice:
        """Return what is missing and what to do."""
        return Notice(code="doctor.missing", text=f"{self.name}: {self.found}; {self.remedy}")


def check_installation() -> Iterator[InstallationFinding]:
    """Yield the checks of Python, packages, compiler, calls, make, cache and shared files."""
    remedy = "" if sys.version_info >= _OLDEST else "install Python 3.11 or later"
    yield InstallationFinding("python", f"{platform.python_version()}, {platform.machine()}", remedy)
    for name in _PACKAGES:
        try:
            found, remedy = version(name), ""
        except PackageNotFoundError:
            found, remedy = "not installed", f"pip install {name}"
        yield InstallationFinding(name, found, remedy)
    compiler = codegen.locate_compiler()
    found = "none" if compiler is None else f"{compiler.path}: {compiler.version}"
    remedy = "" if compiler else "install gcc or clang; until then the slower NumPy code is used"
    yield InstallationFinding("C compiler", found, remedy, needed=compiler is not None)
    calls, make = codegen.choose_call_path(), shutil.which("make")
    yield InstallationFinding("calls of compiled code", calls.name, calls.remedy, needed=False)
    remedy = "" if make else "install make, to build generated folders and run their self-test"
    yield InstallationFinding("make", make or "none", remedy, needed=False)
    folder, size = codegen.locate_cache_folder(), 0
    # Other processes may take entries away at any time: what has gone counts nothing.
    for place, _, names in os.walk(folder):
        for name in names:
            with contextlib.suppress(FileNotFoundError):
                size += Path(place, name).lstat().st_size
    _, inside, _ = next(os.walk(folder), ("", [], []))
    entries = sum(not name.startswith(".") for name in inside)
    existing = next((path for path in (folder, *folder.parents) if path.exists()), folder)
    remedy = "" if os.access(existing, os.W_OK) else "make it writable, or set XDG_CACHE_HOME"
    yield InstallationFinding("cache", f"{folder}: {entries} libraries, {size / 1e6:.1f} MB", remedy)
    for name in ("robots", "templates"):
        try:
            found, remedy = str(locate_resource_folder(name)), ""
        except SymidError:
            found, remedy = "missing", "install symid again"
        yield InstallationFinding(name, found, remedy)


@final
class Doctor(Result):
    """The checks of an installation.

    Attributes:
        findings: Python, packages, compiler, calls of compiled code, make, cache, shared files.

    Example:
        >>> import symid
        >>> found = symid.doctor()
        >>> found.findings[0].name
        'python'
    """

    findings: "tuple[InstallationFinding, ...]"

    @property
    def missing(self) -> "tuple[InstallationFinding, ...]":
        """Return the findings with a remedy."""
        return tuple(entry for entry in self.findings if entry.remedy)

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return what is missing, but not required."""
        return tuple(entry.build_notice() for entry in self.missing if not entry.needed)

    @property
    def errors(self) -> tuple[Notice, ...]:
        """Return what is missing and required."""
        return tuple(entry.build_notice() for entry in self.missing if entry.needed)

    def summarise(self) -> str:
        """Return the number of checks and remedies."""
        return f"{len(self.findings)} checks, {len(self.missing)} remedies"

    def blocks(self) -> "tuple[Block, ...]":
        """Return a table."""
        rows = [(entry.name, entry.found, entry.remedy or "ok") for entry in self.findings]
        return (report.Table(("item", "found", "remedy"), rows, left=(0, 1, 2)),)

    def _describe(self) -> dict[str, object]:
        from symid import __version__

        return {
            "version": __version__,
            "findings": [
                {"name": entry.name, "found": entry.found, "ok": not entry.remedy, "remedy": entry.remedy}
                for entry in self.findings
            ],
        }


def doctor() -> Doctor:
    """Check Python, packages, compiler, cache and shared files; list remedies.

    Example:
        >>> import symid
        >>> symid.doctor().accepted
        True
    """
    return Doctor(findings=tuple(check_installation()))


_ROBOT = "two_link_elastic"
_TRAINING = ("TA10", "TB1", "TB2")
_HELD_OUT = "TC"
_MOST_PARAMETERS = 2.0
_MOST_HYSTERESIS = 3.0
"""Limits of the errors of the demo, percent."""
_AUTOMATIC = "automatic"
_METHODS = ("linear-spring", "two-step", "independent", _AUTOMATIC)
_LOGS = {"TA": "ta.npz", "TA10": "ta10.npz", "TB1": "tb1.npz", "TB2": "tb2.npz", "TC": "tc.npz"}
_OURS = frozenset({"code", *_LOGS.values(), "estimate.json", "identified.toml", "report.html"})
_SCRATCH = tuple(f".{name}{mark}" for name in sorted(_OURS) for mark in ".-")

_FOREIGN, _SHARE = "lugre", 0.2
"""Hidden model of the second arm, and the part of the study's logs that it gets."""
_WHAT = (
    "The arm is simulated with the models that are then identified, stops and knees in its springs and "
    "Coulomb and viscous friction, so that its errors are those of noise alone. A second arm has motors with "
    "LuGre friction, in a simulator that shares no model with the identification. Its errors are those of "
    "models that do not fit, as on real arms."
)
DemoErrors = tuple[float, float]
"""Of parameters and of the hysteresis, percent."""


@final
class DemoResult(JudgedResult):
    """The result of the demo, and its errors.

    Attributes:
        robot: the arm, simulated with the values of its file.
        fits: by method; `automatic` is the one chosen.
        deviations: by method: errors (percent) of the worst parameter, and of the worse hysteresis on a
            held-out motion.
        tracking: closed loops along the held-out motion: rigid feed-forward first, then identified ones.
        foreign: the automatic choice on an arm whose motors have friction that no model of symid's describes.
        seed: of the noise.
        folder: with code, logs, estimate.json, identified.toml and report.html.
        files: C sources.
        built: result of the self-test of the C code, in words.
        judged: the verdict of the page, with what the fit predicts of two held-out logs.

    Example:
        >>> import symid
        >>> result = symid.demo("demo")  # doctest: +SKIP
        >>> result.report  # doctest: +SKIP
        PosixPath('demo/report.html')
    """

    robot: RobotModel
    fits: Mapping[str, ElasticFit]
    deviations: Mapping[str, DemoErrors]
    tracking: "tuple[elastic.TrackingRun, ...]"
    foreign: "studies.foreign_truths.ForeignRun"
    seed: int
    folder: Path
    files: tuple[Path, ...]
    built: str
    judged: "FitVerdict"

    @property
    def verdict(self) -> "FitVerdict":
        """Return the verdict of the page."""
        return self.judged

    @property
    def fit(self) -> ElasticFit:
        """Return the result of the automatic choice among methods."""
        return self.fits[_AUTOMATIC]

    @property
    def report(self) -> Path:
        """Return the page."""
        return self.folder / "report.html"

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return warnings and notes on compiled functions and fit."""
        return (*self.robot.library.notices, *self.fit.estimate.notices)

    @property
    def errors(self) -> tuple[Notice, ...]:
        """Return the errors that exceed their limits."""
        return judge_demo(self.deviations[_AUTOMATIC], self.tracking)

    def summarise(self) -> str:
        """Return the errors against the true values."""
        parameters, hysteresis = self.deviations[_AUTOMATIC]
        return f"{self.robot.name}: parameters {parameters:.3g} %, hysteresis {hysteresis:.3g} % error"

    def blocks(self) -> "tuple[Block, ...]":
        """Return parameters, springs, errors, tracking, and the paths of the files."""
        best = self.fit.estimate
        logs = ", ".join(_LOGS[name] for name in _TRAINING)
        chosen = f"{_AUTOMATIC}: {best.method}"
        errors = [[chosen if name == _AUTOMATIC else name, *pair] for name, pair in self.deviations.items()]
        header = ["feed-forward", *(f"{joint.name}/mrad" for joint in self.robot.joints)]
        rows = [[run.name, *(1e3 * run.rms).tolist()] for run in self.tracking]
        foreign = self.foreign
        second = f"the arm with LuGre friction: {foreign.verdict}"
        if foreign.chosen:
            second = f"the arm with LuGre friction, method {foreign.chosen}: parameters {foreign.worst:.2g} "
            second += f"%, hysteresis {foreign.spring:.2g} %; errors {foreign.z_rms:.2g} times the stated "
            second += f"deviations (rms), verdict {foreign.verdict}"
        return (
            _WHAT,
            f"{self.robot.name}: dynamics, friction and hysteresis identified from {logs}\n{best.reason}",
            report.texts.show_elastic_parameters(best),
            report.texts.show_springs(best),
            (
                "errors in percent: largest error of a dynamic parameter; hysteresis of the worse joint on "
                f"the held-out motion {_LOGS[_HELD_OUT]}"
            ),
            report.Table(["method", "parameters", "hysteresis"], errors),
            second,
            f"RMS tracking errors of the links in closed loop, motion of {_LOGS[_HELD_OUT]}",
            report.Table(header, rows),
            f"{len(self.files)} files of C in {show_path(self.folder / 'code')}, {self.built}",
            f"robot file with the identified values: {show_path(self.folder / 'identified.toml')}",
            f"report: {self.report.resolve()}",
        )

    def _describe(self) -> dict[str, object]:
        return {
            "estimate": report.texts.describe_elastic(self.fit.estimate),
            "errors": {
                name: {"parameter_percent": pair[0], "hysteresis_percent": pair[1]}
                for name, pair in self.deviations.items()
            },
            "tracking_rms": {run.name: run.rms.tolist() for run in self.tracking},
            "foreign": asdict(self.foreign),
            "seed": self.seed,
            "backend": self.robot.library.backend,
            "code": self.folder / "code",
            "identified": self.folder / "identified.toml",
            "report": self.report,
        }


def demo(
    folder: str | PathLike[str] = "demo",
    *,
    seed: int = 0,
    backend: str = "auto",
    force: bool = False,
    progress: Progress = ignore,
) -> DemoResult:
    """Simulate an arm with elastic joints, identify dynamics and hysteresis, validate, report.

    Args:
        folder: for code, logs, estimate and report; created if it does not exist.
        seed: of the noise.
        backend: what computes the arm's functions: "auto", "c", "python" or "casadi".
        force: overwrite the files of an earlier demo; other files are always refused.
        progress: called with a short text at each stage.

    Raises:
        OutputError: the folder is not empty, or cannot be created.

    Example:
        >>> import symid
        >>> result = symid.demo("demo")  # doctest: +SKIP
        >>> result.accepted  # doctest: +SKIP
        True
    """
    place = Path(folder)
    _prepare_folder(place, force=force)
    robot = load(_ROBOT, backend=backend, progress=progress)
    code = robot.write("c", place / "code", force=True)
    library, card = robot.library, robot.library.card
    progress("simulating five experiments with noisy sensors")
    noisy = studies.elastic_methods.SensorCondition.NOISY
    runs, logs = studies.elastic_methods.simulate_runs(robot.description, library, noisy), dict[str, Log]()
    for name, file in _LOGS.items():
        # Written and read again, like those of a real robot.
        (recording,) = studies.elastic_methods.observe_runs(runs, (name,), noisy, seed)
        logs[name] = read_log(log_files.write_recording(recording, place / file, robot.description), robot)
    training = [logs[name].recording for name in _TRAINING]
    # What `robot.identify` gives by each method; the equations are built once.
    identify = identification.prepare_elastic_methods(
        robot.description, training, identification.IdentifyOptions(), robot.context
    )
    makers = {"independent": studies.elastic_methods.fit_independent}
    fits = {
        method: cast("ElasticFit", build_dynamics_fit(identify(makers.get(method, method)), robot))
        for method in _METHODS
    }
    models = {method: fit.estimate.build_fit(card) for method, fit in fits.items()}
    truth, last = studies.elastic_methods.get_true_parameters(card), runs[_HELD_OUT]
    deviations = {}
    for method, model in models.items():
        error = studies.elastic_methods.compute_parameter_error(model, truth)
        loops = studies.elastic_methods.compute_hysteresis_errors(model, last.phi, last.joint_torque)
        deviations[method] = (error, float(loops.max()))
    estimate = fits[_AUTOMATIC].save(place / "estimate.json")
    export_fit(robot.description, estimate, place / "identified.toml", ExportOptions(accept=True), progress)
    progress("tracking the held-out motion with feed-forward of the identified models")
    tracking = elastic.simulate_tracking(
        robot.description,
        library,
        {
            "Case 1: identified together": models[_AUTOMATIC],
            "Case 2: identified apart": models["independent"],
        },
        excitation.build_tc(),
        simulation.build_noisy_options(),
        progress=progress,
    )
    progress("simulating and identifying an arm with friction of another kind")
    foreign = studies.foreign_truths.try_foreign(_FOREIGN, seed, report.judge_fit, share=_SHARE)
    progress("writing the report")
    best = fits[_AUTOMATIC].estimate
    initial = [spring.elasticity for spring in fits["linear-spring"].estimate.springs]
    held_out = [logs[name].recording for name in (_HELD_OUT, "TA")]
    page = report.build_elastic_page(
        best,
        tuple(elastic.evaluate_elastic(best, library, log, initial=initial) for log in held_out),
        notices=(*robot.notices, *library.notices),
        origin=report.describe_origin(robot.description, library, [log.recording for log in logs.values()]),
        iterated=fits["two-step"].estimate,
        tracking=tracking,
    )
    report.write_page(place / "report.html", page)
    return DemoResult(
        robot=robot,
        fits=fits,
        deviations=deviations,
        tracking=tracking,
        foreign=foreign,
        seed=seed,
        folder=place,
        files=code.files,
        built="compiled, self-test passed" if code.selftest == "passed" else "not compiled: no C compiler",
        judged=page.verdict,
    )


def _prepare_folder(folder: Path, *, force: bool) -> None:
    """Create the folder; refuse one with other files, and without `force` one of an earlier demo."""
    if folder.is_file():
        text = "is a file, not a folder; give the name of a folder"
        raise OutputError(Notice(code="output.not-a-folder", text=text, file=str(folder)))
    found = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    # What a demo that was killed left of a file, or of the lock of its code, goes with the next one.
    found = {name for name in found if not name.startswith(_SCRATCH)}
    if found and (found - _OURS or not force):
        text = "is not empty; give another folder with -o"
        if not found - _OURS:
            text += ", or --force to overwrite the last demo"
        raise OutputError(Notice(code="output.foreign-folder", text=text, file=str(folder)))
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        text = f"cannot be created: {error.strerror}"
        raise OutputError(Notice(code="output.cannot-write", text=text, file=str(folder))) from error


def judge_demo(deviations: DemoErrors, tracking: "Sequence[elastic.TrackingRun]") -> tuple[Notice, ...]:
    """Return the errors that exceed their limits.

    Args:
        deviations: errors (percent) of parameters and of the hysteresis.
        tracking: with rigid feed-forward first, then with that of the identified model.
    """
    parameters, hysteresis = deviations
    limits = (
        ("demo.off-truth", "largest parameter", parameters, _MOST_PARAMETERS),
        ("demo.off-spring", "hysteresis", hysteresis, _MOST_HYSTERESIS),
    )
    notices = [
        Notice(code=code, text=f"{what} error {error:.3g} %; the limit is {most:g} %")
        for code, what, error, most in limits
        if not error <= most
    ]
    if not (tracking[1].rms < tracking[0].rms).all():
        text = "feed-forward of the identified model does not reduce the tracking errors of the rigid one"
        notices.append(Notice(code="demo.no-gain", text=text))
    return tuple(notices)
