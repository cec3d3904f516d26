"""The robot of the API: a description with everything that can be done with it.

Name or path of a robot file -> `RobotModel`, whose methods are named as the verbs are.

    robot = symid.load("panda")
    robot.base                      its base parameters, exactly
    robot.sympy("mass_matrix")      exact expressions; robot.casadi(...) the same as a CasADi function
    robot.identify(["train.csv"])   parameters from logs

Supported: robot files, URDF, MJCF, tables of Denavit-Hartenberg rows. Nothing heavy is loaded before use.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar, final

from symid import (
    codegen,
    dynamics,
    excitation,
    identification,
    lessons,
    logs as log_files,
    report,
    robot as robots,
    simulation,
    study as studies,
)
from symid.api.dynamics import BaseForm, BaseSet, derive_base_set
from symid.api.experiment import list_seeds
from symid.api.result import Figures, Progress, check_choice, ignore
from symid.codegen import BACKENDS
from symid.environment import report_count
from symid.errors import Notice, UsageError
from symid.identification import IdentifyOptions, LawOptions, diagnostics, elastic, rigid as rigid_fits
from symid.options import (
    ExciteOptions,
    GenerateOptions,
    PayloadOptions,
    Precision,
    SimulateOptions,
    Target,
    merge,
)

if TYPE_CHECKING:
    import casadi as ca

    from symid.api.code import CompiledModel, WrittenCode
    from symid.api.dynamics import Derivation, LessonParameters, MarkedSheet, Notation, WrittenLesson
    from symid.api.experiment import ExcitedTrajectory, Simulation, Study
    from symid.api.fit import ElasticFit, Fit, FrictionFit, RigidFit
    from symid.api.identification import (
        OneShotProblem,
        PayloadResult,
        PayloadSide,
        Stiffness,
    )
    from symid.api.log import LogLike, Logs, Parts, RobotCheck
    from symid.api.robot_files import ExportedFile
    from symid.codegen import Library, SymbolicFunction
    from symid.excitation import SampledMotion, Trajectory
    from symid.logs import Recording
    from symid.report import Block
    from symid.robot import Joint, Robot
    from symid.study import CutoffStudy, ElasticStudy, ManyJointsResult, PrecisionStudy, TrackingStudy

T = TypeVar("T")
Settings = str | Mapping[str, object]
"""Settings in place of the robot file's: the name of a set in the file, or values by dotted key.

The set "published" is `"published"`, a value is `{"processing.filter_cutoff": 50}`; both together are
`{"settings": "published", "processing.filter_cutoff": 50}`, in which the value wins. See docs/robot_file.md.
"""


def list_pairs(
    settings: Settings | None, options: IdentifyOptions | LawOptions | None = None
) -> tuple[tuple[str, str], ...]:
    """Return pairs of key and text from settings, and from options that are settings by another name.

    Args:
        settings: a set's name, or values by dotted key; a list may be given as one.
        options: whose cutoff, decimate, drop_first and drop_last are settings where they are given.
    """
    keyed = {"settings": settings} if isinstance(settings, str) else settings or {}
    pairs = [*keyed.items()]
    if options is not None:
        names = ("cutoff", "decimate", "drop_first", "drop_last")
        keys = ("filter_cutoff", "decimation.factor", "drop_first", "drop_last")
        named = zip(keys, (getattr(options, name) for name in names), strict=True)
        pairs += [(f"processing.{key}", value) for key, value in named if value is not None]
    return tuple((key.strip(), _write_value(value)) for key, value in pairs)


def _to_plain(value: T) -> T:
    """Return a number or an array of NumPy in Python's own types, and all else as it is."""
    plain: T = value.tolist() if hasattr(value, "tolist") else value
    return plain


def _write_value(value: object) -> str:
    """Return a value as a robot file has it."""
    value = _to_plain(value)
    match value:
        case None:
            return "none"
        case bool():
            return "true" if value else "false"
        case list() | tuple():
            return ", ".join(map(_write_value, value))
    return str(value).strip()


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RobotModel:
    """A robot with everything that can be done with it; made by `symid.load`.

    Attributes:
        description: joints, placements, drives, friction, springs, log map, as read and overridden.
        backend: what computes its functions: "auto" (compiled C, else NumPy), "c", "python" or "casadi".
        progress: called with a short text at each stage; does nothing by default, `print` is a good choice.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link")
        >>> [joint.name for joint in robot.joints], robot.elastic
        (['shoulder', 'elbow'], False)
    """

    description: "Robot"
    backend: str = "auto"
    progress: Progress = ignore

    @property
    def name(self) -> str:
        """Return the name that the robot file states."""
        return self.description.name

    @property
    def path(self) -> Path:
        """Return the file that the robot was read from."""
        return Path(self.description.path)

    @property
    def joints(self) -> "tuple[Joint, ...]":
        """Return the joints that have a coordinate of their own, in the order of q."""
        return self.description.axes

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return warnings and notes on the robot file, such as the parts of a URDF that are not used."""
        return self.description.notices

    @property
    def elastic(self) -> bool:
        """Return whether any joint is elastic."""
        return any(self.description.elastic)

    def __getstate__(self) -> dict[str, object]:
        """Return the state to copy or pickle, without compiled functions, which are loaded again on use."""
        return {name: value for name, value in self.__dict__.items() if name != "library"}

    def __repr__(self) -> str:
        """Return the robot in one line."""
        joints = f"{len(self.joints)} joint{'s'[: len(self.joints) != 1]}"
        return f"<RobotModel {self.name}: {joints}{', elastic' if self.elastic else ''}, {self.path}>"

    def override(
        self,
        *,
        settings: Settings | None = None,
        friction: str | None = None,
        backend: str | None = None,
        progress: Progress | None = None,
    ) -> "RobotModel":
        """Return the robot with other settings.

        Args:
            settings: a set of the robot file by its name, or keys under its `log`, `processing` and
                `controller`, with values.
            friction: the friction model of all joints.
            backend: what computes its functions.
            progress: called with a short text at each stage.

        Raises:
            UsageError: a setting cannot be made, or its value does not fit.

        Example:
            >>> import symid
            >>> robot = symid.load("two_link").override(settings={"processing.filter_cutoff": 20})
            >>> robot.description.processing.filter_cutoff
            20.0
        """
        check_choice("backend", backend or self.backend, BACKENDS)
        changed = robots.override_settings(self.description, list_pairs(settings), friction)
        backend, progress = backend or self.backend, progress or self.progress
        return replace(self, description=changed, backend=backend, progress=progress)

    # Base parameters.

    @cached_property
    def base(self) -> BaseSet:
        """Return the base parameters: the smallest set that describes all motions and torques.

        Example:
            >>> import symid
            >>> symid.load("panda").base.count
            43
        """
        return derive_base_set(self.description)

    def derive_base(self, form: BaseForm = "torque") -> BaseSet:
        """Return the base parameters of the torques, energies, momentum, or torques at rest ("gravity").

        Args:
            form: "torque", "energy", "momentum" or "gravity".

        Example:
            >>> import symid
            >>> symid.load("two_link").derive_base("gravity").names
            ('MXR1', 'MY1', 'MX2', 'MY2')
        """
        return self.base if form == "torque" else derive_base_set(self.description, form)

    # Derivation, exact functions and code.

    def derivation(self, *, latex: bool = False) -> "Derivation":
        """Return the derivation of the dynamics, from the frames to the torques, with a check of each step.

        Args:
            latex: print formulas in LaTeX.

        Raises:
            RobotError: a symbolic length has no value.

        Example:
            >>> import symid
            >>> lesson = symid.load("emps").derivation()
            >>> lesson.steps[0].title
            'Frames'
        """
        from symid.api.dynamics import Derivation

        self.progress(f"deriving the dynamics of {self.name}")

        steps = lessons.derive_lesson(self.description)
        self.progress("counting the operations of all routes to code")
        counts = codegen.count_route_operations(self.description)
        return Derivation(robot=self.description, steps=steps, operations=counts, latex=latex)

    def write_lesson(
        self,
        path: str | PathLike[str],
        *,
        notation: "Notation" = "symid",
        parameters: "LessonParameters | None" = None,
        angle: Literal["q", "theta"] | None = None,
        long_sines: bool = False,
        exercises: int = 0,
        seed: int = 0,
        log: "LogLike | None" = None,
    ) -> "WrittenLesson":
        """Write the derivation as one self-contained page: formulas, their numbers, checks, the arm to move.

        Args:
            path: of the page, `.html`; `.tex` for a document for pdflatex, `.ipynb` for a notebook with live
                SymPy objects, executed where nbclient and ipykernel are there.
            notation: letters of symid, or of Siciliano et al., Craig, or Khalil and Dombre.
            parameters: "base", the file's "symbols", or "bodies" (masses, centres of mass, inertias). None
                takes symbols where the file has them, bodies in the books that use them, else base.
            angle: "q" or "theta" in place of the book's own letter.
            long_sines: write cos(q1 + q2) in place of c12.
            exercises: how many stand at the end; a sheet to fill in (`check_answers` marks it) and the
                answers go to text files beside the page.
            seed: of the exercises.
            log: a log or its file, whose motion (at most 30 s) the page offers beside drawn ones.

        Raises:
            RobotError: a symbolic length has no value.
            LogError: the log cannot be read or used; the message lists all mistakes.
            OutputError: the page cannot be written.

        Example:
            >>> import symid
            >>> symid.load("two_link").write_lesson("arm.html").notation
            'symid'
        """
        from symid.api.dynamics import write_lesson

        self.progress(f"deriving the lesson on {self.name}")
        options: dict[str, Any] = {"long_sines": long_sines, "exercises": exercises, "seed": seed, "log": log}
        return write_lesson(self.description, path, notation, parameters, angle, **options)

    def check_answers(self, path: str | PathLike[str]) -> "MarkedSheet":
        """Mark the answers that were typed into the sheet of a lesson's exercises.

        Formulas are compared exactly: any form of the right polynomial is right. A number is right to one
        percent. The sheet says with which settings its exercises were drawn.

        Args:
            path: of the sheet, as `write_lesson` with `exercises` wrote it beside the page.

        Raises:
            InputError: the file is no such sheet, or one of another robot.

        Example:
            >>> import symid
            >>> robot = symid.load("two_link")
            >>> sheet = robot.write_lesson("arm.html", exercises=2).sheet
            >>> robot.check_answers(sheet)
            <MarkedSheet two_link: arm.exercises.txt, 0 of 2 right>
        """
        from symid.api.dynamics import check_answers

        return check_answers(self.description, path)

    def sympy(self, name: str, *, standard: bool = False) -> "SymbolicFunction":
        """Return a function of the catalogue as exact SymPy expressions.

        Args:
            name: of the function, such as "mass_matrix".
            standard: whether it takes the standard parameters pi in place of beta.

        Raises:
            UsageError: the robot has no such function; the message has the nearest names.

        Example:
            >>> import symid
            >>> gravity = symid.load("two_link").sympy("gravity")
            >>> gravity
            gravity(q, beta) -> g
            >>> gravity["g"].shape
            (2, 1)
        """
        self._check_function(name)
        return codegen.derive_symbolic(self.description, name, standard=standard, base=self.base.product)

    def casadi(
        self, name: str, *, standard: bool = False, constant: bool = False, compiled: bool = False
    ) -> "ca.Function":
        """Return a function of the catalogue as a CasADi function, with derivatives of any order.

        Vectors are columns; matrices of samples side by side and `map` work as CasADi has them. SI units.

        Args:
            name: of the function, such as "forward_dynamics".
            standard: whether it takes the standard parameters pi in place of beta.
            constant: use the robot file's values of beta, rotors and friction as constants; the parameters h
                of springs stay arguments.
            compiled: of inverse and forward dynamics, call the generated C, for the values and for first
                derivatives; there are no second ones, so Ipopt needs `hessian_approximation`
                "limited-memory", or a Gauss-Newton matrix.

        Raises:
            GenerationError: `compiled`, and no C compiler works.
            RobotError: a symbolic length has no value.
            UsageError: the robot has no such function, or its file lacks a value for a constant.

        Example:
            >>> import symid
            >>> gravity = symid.load("two_link").casadi("gravity", constant=True)
            >>> gravity.size1_in("q")
            2
        """
        self._check_function(name)
        if compiled:
            return codegen.build_compiled_function(
                self.description, name, standard=standard, constant=constant
            )
        return codegen.build_casadi_function(self.description, name, standard=standard, constant=constant)

    def _check_function(self, name: str) -> None:
        """Refuse a function that the catalogue does not have for this robot, with the nearest names."""
        if name in codegen.LIMITED:
            # Written on request, or for few coordinates: the error says so.
            codegen.list_robot_specs(self.description, self.base.product, (name,))
            return
        names = [spec.name for spec in codegen.list_robot_specs(self.description, self.base.product)]
        if name not in names:
            hint = robots.suggest_names(name, names, otherwise="there are")
            text = f"function {name!r} is not in the catalogue of {self.name}: {hint}"
            raise UsageError(Notice(code="usage.unknown-function", text=text))

    def compile(self, *, fused: bool = False) -> "CompiledModel":
        """Return all functions of the robot, compiled and loaded by its `backend`, as attributes.

        Args:
            fused: let the C compiler make one instruction (FMA) of a product and a sum, which saves about a
                tenth of the time. Last digits then depend on compiler and processor.

        Raises:
            RobotError: a symbolic length has no value.
            GenerationError: there is no compiler and the backend is "c", or it fails.

        Example:
            >>> import symid
            >>> lib = symid.load("two_link").compile()
            >>> lib.mass_matrix([0.1, 0.2], lib.beta).shape
            (2, 2)
        """
        from symid.api.code import CompiledModel

        if fused:
            return CompiledModel(self._prepare(self.description, fused=True, whole=True))
        return CompiledModel(self._whole_library)

    def write(
        self,
        target: Target,
        folder: str | PathLike[str],
        *,
        functions: Sequence[str] | None = None,
        precision: Precision = "double",
        parameters: Literal["base", "standard"] = "base",
        constant: bool = False,
        trigonometry: Literal["own", "library"] = "own",
        friction_laws: bool = False,
        force: bool = False,
    ) -> "WrittenCode":
        """Write the robot's functions as code that stands alone, and run its self-test.

        Springs with branches (`model` in [joint.elasticity]), backlash or an offset get a folder each in it.
        Where neither the robot nor anything else has changed since the last time, nothing is done.

        Args:
            target: "c", "python" (one module of NumPy), "js" (one of JavaScript), or "casadi" (functions,
                their C, and a loader).
            folder: new, or written by symid earlier; other files in it are not changed.
            functions: the names of those wanted; all by default.
            precision: type of all numbers in C.
            parameters: arguments of the functions: "base" for beta, "standard" for all standard parameters
                pi.
            constant: use the robot file's values as constants.
            trigonometry: sines in C: "own" (code that computes all angles at once) or "library" (the C
                library).
            friction_laws: add all static friction laws to the C library.
            force: overwrite files that were edited since.

        Raises:
            RobotError: a symbolic length has no value.
            UsageError: a value is not offered, the robot has no such function, or its file lacks a value that
                is to be constant.
            OutputError: the folder cannot be written, or belongs to something else.
            GenerationError: the code fails its self-test.

        Example:
            >>> import symid
            >>> symid.load("two_link").write("python", "code", functions=["gravity"]).selftest
            'passed'
        """
        from symid.api.code import WrittenCode

        order = GenerateOptions(
            target=target,
            functions=None if functions is None else tuple(functions),
            precision=precision,
            parameters=parameters,
            constant=constant,
            trigonometry=trigonometry,
            friction_laws=friction_laws,
        )
        path = Path(fspath(folder))
        made = codegen.generate_folder(self.description, order, path, progress=self.progress, force=force)
        springs, notices = codegen.generate_springs(
            self.description, order, path, progress=self.progress, force=force
        )
        whole = replace(made, springs=springs, notices=(*made.notices, *notices))
        return WrittenCode(robot=self.description, product=whole)

    @cached_property
    def library(self) -> "Library":
        """Return the functions that identification and simulation run on, from the cache or made now.

        `compile` has the derivatives, the Coriolis matrix and the regressor of Slotine and Li as well.
        """
        return self._prepare(self.description)

    @cached_property
    def _whole_library(self) -> "Library":
        return self._prepare(self.description, whole=True)

    # Logs.

    def check(self, *logs: "LogLike", resample: str | PathLike[str] | None = None) -> "RobotCheck":
        """Return a summary of the robot file, and which parameters are identifiable from logs.

        Checks time stamps, units, steps and limits; with the dynamics also signs, exchanged joints, delays,
        and which parameters are identifiable from all logs together.

        Args:
            logs: files, files that list runs, or logs that were read; none to check the robot file alone.
            resample: a file, .npz or .csv, for an evenly sampled copy of the one log.

        Raises:
            UsageError: `resample` is given with several logs.
            LogError: a log cannot be used; the message lists all mistakes.
            OutputError: the copy cannot be written.

        Example:
            >>> import symid
            >>> robot = symid.load("two_link")
            >>> robot.check(robot.simulate(duration=4).log).accepted
            True
        """
        from symid.api.log import RobotCheck, list_logs

        if resample is not None and len(logs) != 1:
            text = f"resample: a copy is made of one log at a time, got {len(logs)}"
            raise UsageError(Notice(code="usage.one-log", text=text))
        found = diagnostics.LogsCheck()
        if logs:
            found = diagnostics.check_robot_logs(
                self.description,
                list_logs(logs),
                prepare=lambda: self.library,
                progress=self.progress,
                output=None if resample is None else Path(fspath(resample)),
            )
        return RobotCheck(robot=self.description, product=found)

    def plot(self, what: "LogLike | None" = None, *, pose: Sequence[float] | None = None) -> Figures:
        """Return figures of the robot, of a log, of a trajectory or of a fit; `.save(path)` writes them.

        Args:
            what: a log or its file, the .csv of a trajectory, or the .json of a fit; None for the robot.
            pose: coordinates of the joints that follow no other, rad or m, for the robot; 0 by default.

        Raises:
            UsageError: `pose` has the wrong length, or is given with a file.
            LogError: the log or trajectory cannot be used.
            EstimateError: the fit cannot be used.

        Example:
            >>> import symid
            >>> symid.load("scara").plot(pose=[0.3, 0.6, 0.1, 0.0]).save("scara.svg").name
            'scara.svg'
        """
        from symid.api.fit import load_fit
        from symid.api.log import list_logs

        robot = self.description
        if what is None:
            return Figures(drawings=(report.draw_robot(robot, pose),))
        if pose is not None:
            text = "pose is of the robot, and here a file is drawn; leave one of them out"
            raise UsageError(Notice(code="usage.pose", text=text))
        if isinstance(what, str | PathLike):
            path = Path(fspath(what))
            if path.suffix.lower() == ".json":
                return load_fit(path, self).plot()
            if excitation.is_trajectory(path):
                return Figures(drawings=report.draw_motion(excitation.read_trajectory(path, robot), robot))
        read = log_files.read_recordings(list_logs((what,)), robot, uneven=True)
        logs = [diagnostics.summarise_log(recording, robot) for recording in read]
        return Figures(
            drawings=tuple(drawing for log in logs for drawing in report.draw_log(log.recording, robot, log))
        )

    # Identification.

    @property
    def context(self) -> "identification.TaskContext":
        """Return compiled functions on demand, and the callback for progress, for long computations."""

        def prepare(description: "Robot") -> "Library":
            """Return this robot's library, loaded once, where the dynamics are its own."""
            own = codegen.keep_dynamics(description) == codegen.keep_dynamics(self.description)
            return self.library if own else self._prepare(description)

        return identification.TaskContext(prepare=prepare, progress=self.progress)

    def _prepare(self, description: "Robot", *, fused: bool = False, whole: bool = False) -> "Library":

        return codegen.prepare_library(
            description, progress=self.progress, backend=self.backend, fused=fused, whole=whole
        )

    def identify(
        self,
        logs: "Logs",
        *,
        train: "Parts | None" = None,
        rows: str | None = None,
        estimator: str | None = None,
        method: str | None = None,
        friction: str | Mapping[str, str] | None = None,
        settings: Settings | None = None,
        cutoff: float | None = None,
        decimate: int | None = None,
        period: float | Sequence[float] | None = None,
        known: "Fit | RobotModel | str | PathLike[str] | Mapping[str, float] | None" = None,
        partial: bool | None = None,
        options: IdentifyOptions | None = None,
    ) -> "RigidFit | ElasticFit":
        """Identify base parameters and friction from logs; for elastic joints also springs and hysteresis.

        Robot and logs decide the model: rigid; elastic, if joints are elastic and the logs have positions of
        motors and links; otherwise the motor side alone.

        Args:
            logs: files, files of runs, or logs that were read.
            train: the part of the logs to fit, such as "0:60%", or two numbers in s from the first sample,
                None for an open end; one for all logs, or a list of one for each.
            rows: how measurements become equations: "torque" (the default), "momentum", "filtered", "power"
                or "energy".
            estimator: how equations become parameters: "ols", "wls", "filtered-instrumental", "gls", "huber",
                "ridge", "consistent", "sequential", "output-error" or "instrumental"; chosen from the logs
                among the first three by default.
            method: of elastic joints: "automatic" (the default), "two-step", "linear-spring", "elimination",
                "weighted", "nlp", "simultaneous" or "independent".
            friction: the friction law of all joints, in place of the robot file's, its shape values found
                from the logs; "auto" for the law of each joint that predicts held-out torque best. Or laws
                of single joints, such as {"elbow": "stribeck", "wrist": "auto"}; the others keep theirs.
            settings: replace those of the robot file: a set by its name, or values by dotted key.
            cutoff: Hz, of the low-pass filter.
            decimate: keep one sample in so many.
            period: s, of a repeated motion, for "gls": one value for all logs, or one for each.
            known: for elastic joints: dynamics that are not identified: a robot with values (such as those of
                CAD) or its file (.toml, .urdf, .xml), its links and the rotors whose inertia it states; a fit
                of this robot or its file; or parameters by name, in SI units.
            partial: fit the identifiable parameters even if they are less than three quarters of all.
            options: all options, such as `symid.IdentifyOptions(prior=fit, window=0.5)`; the arguments above
                take precedence.

        Raises:
            UsageError: options that do not go together, or not with this robot and these logs.
            LogError: a log cannot be read or used; the message lists all mistakes.
            EstimateError: `prior`, `start` or `known` is of another model, or its robot lacks values.
            IdentifiabilityError: too few parameters are identifiable; the message names the others.
            SolverError: a search ended without a usable result.

        Example:
            >>> import symid
            >>> robot = symid.load("two_link")
            >>> fit = robot.identify(robot.simulate(seed=1).log, estimator="wls")
            >>> abs(fit["ZZ2"].value - robot.base.values["ZZ2"]) < 4 * fit["ZZ2"].std
            True
        """
        from symid.api.fit import build_dynamics_fit

        order = merge(
            options,
            IdentifyOptions(),
            rows=rows,
            estimator=estimator,
            method=method,
            friction=friction,
            cutoff=cutoff,
            decimate=decimate,
            period=period,
            known=known,
            partial=partial,
        )
        rigid_fits.check_estimator(order.rows or "torque", order.estimator)
        law = identification.read_joint_laws(order.friction, self.description)
        searched = law if identification.needs_search(law) else None
        stated = law if isinstance(law, str) and not searched else None
        pairs = list_pairs(settings, order)
        described, recordings = self._gather(logs, pairs, stated, train)
        found = identification.identify_robot(
            described, recordings, replace(order, friction=searched), self.context, pairs
        )
        return build_dynamics_fit(found, self)

    def _gather(
        self,
        logs: "Logs",
        pairs: tuple[tuple[str, str], ...],
        friction: str | None,
        train: "Parts | None",
    ) -> "tuple[Robot, tuple[Recording, ...]]":
        """Return the robot with the settings of the call, and what it fits of the recordings."""
        from symid.api.log import adopt_log_map, list_logs, list_parts

        given = list_logs(logs, pairs)
        described = robots.override_settings(adopt_log_map(self.description, logs), pairs, friction)
        parts = list_parts(train, "--train")
        return described, log_files.take_parts(
            log_files.read_fit_recordings(given, described), parts, "--train", keep=True
        )

    def identify_friction(
        self,
        logs: "Logs",
        *,
        train: "Parts | None" = None,
        model: str | Mapping[str, str] | None = None,
        estimator: str | None = None,
        known: "Fit | RobotModel | str | PathLike[str] | None" = None,
        smoothing: float | None = None,
        period: float | Sequence[float] | None = None,
        seed: int | None = None,
        friction: str | None = None,
        settings: Settings | None = None,
        options: LawOptions | None = None,
    ) -> "FrictionFit":
        """Identify a friction law and its parameters for every joint that moves.

        Args:
            logs: files, files of runs, or logs that were read.
            train: the part of the logs to fit, as for `identify`.
            model: a law, such as "stribeck+offset", or "auto" (the default): chosen on held-out data; or laws
                of single joints by name, chosen for the others.
            estimator: "varpro" (the default), "root-finding", "nlp", "genetic", "annealing" or
                "differential-evolution".
            known: base parameters to subtract: a fit or its file, or a robot with values (such as those of
                CAD) or its file, .toml, .urdf or .xml; otherwise the rigid part is fitted too.
            smoothing: rad/s or m/s over which dry friction changes its sign.
            period: s, of a cosine motion, to average over all periods: one value for all logs, or one for
                each.
            seed: of a stochastic estimator.
            friction: the friction model of all joints in the rigid part, in place of the robot file's.
            settings: replace those of the robot file: a set by its name, or values by dotted key.
            options: all options, such as `symid.LawOptions(cutoff=20.0)`; the arguments above win.

        Raises:
            UsageError: there is no such law or estimator.
            EstimateError: `known` is of another model, or its robot lacks values.
            LogError: a log cannot be read or used.
            IdentifiabilityError: no joint has an identifiable law.
            SolverError: a search ended without usable numbers.

        Example:
            >>> import symid
            >>> robot = symid.load("two_link")
            >>> fit = robot.identify_friction(robot.simulate(seed=1).log, model="coulomb-viscous")
            >>> sorted(fit.joints)
            ['elbow', 'shoulder']
        """
        from symid.api.fit import FrictionFit

        order = merge(
            options,
            LawOptions(),
            model=model,
            estimator=estimator,
            known=known,
            smoothing=smoothing,
            period=period,
            seed=seed,
            friction=friction,
        )
        given = self._gather(logs, list_pairs(settings, order), order.friction, train)
        found = identification.identify_robot_friction(*given, order, self.context)
        extra = {"backend": found.backend}
        return FrictionFit(estimate=found.estimate, model=self, remarks=found.notices, extra=extra)

    def identify_stiffness(
        self,
        logs: "Logs",
        *,
        train: "Parts | None" = None,
        friction: str | None = None,
        settings: Settings | None = None,
        drop_first: int | None = None,
        drop_last: int | None = None,
    ) -> "Stiffness":
        """Identify delay and offsets of the encoders, and the stiffness of every joint, with intervals.

        The `logs` have the positions of motors and links, of any robot. `train`, `friction`, `settings`,
        `drop_first` and `drop_last` are those of `identify`.

        Raises:
            UsageError: a setting has no meaning for a stiffness.
            LogError: a log lacks an encoder, or is too short.

        Example:
            >>> import symid
            >>> robot = symid.load("two_link_elastic")
            >>> found = robot.identify_stiffness(robot.simulate(duration=6.0, seed=1).log)
            >>> sorted(found.joints)
            ['elbow', 'shoulder']
        """
        from symid.api.identification import Stiffness

        pairs = list_pairs(settings, IdentifyOptions(drop_first=drop_first, drop_last=drop_last))
        described, recordings = self._gather(logs, pairs, friction, train)
        found, notices = identification.identify_stiffness(described, recordings, pairs, self.context)
        return Stiffness(estimate=found, notices=notices)

    def one_shot(
        self,
        logs: "Logs",
        *,
        train: "Parts | None" = None,
        settings: Settings | None = None,
        options: IdentifyOptions | None = None,
    ) -> "OneShotProblem":
        """Return the problem of the method "nlp" as CasADi expressions, open to terms and constraints.

        The problem is that of the last round, and starts at the fit. `logs`, `train`, `settings` and
        `options` are those of `identify`.

        Raises:
            UsageError: no joint is elastic, or a setting does not apply.
            LogError: a log lacks an encoder, or cannot be used.
            IdentifiabilityError: no spring is identifiable.

        Example:
            >>> import symid
            >>> robot = symid.load("two_link_elastic")
            >>> problem = robot.one_shot(robot.simulate(duration=4.0, seed=1).log)
            >>> problem.add_constraint(problem["IA1"], upper=0.2).solve()["IA1"] <= 0.2
            True
        """
        from symid.api.identification import OneShotProblem

        order = options or IdentifyOptions()
        pairs = list_pairs(settings, order)
        described, recordings = self._gather(logs, pairs, None, train)
        graph, notices = identification.build_elastic_graph(described, recordings, order, pairs, self.context)
        return OneShotProblem(robot=self, graph=graph, remarks=notices)

    # Trajectories and experiments.

    def excite(
        self,
        *,
        harmonics: int | None = None,
        period: float | None = None,
        criterion: Literal["condition", "d-optimal"] | None = None,
        start: Sequence[float] | None = None,
        share: float | None = None,
        workspace: str | PathLike[str] | None = None,
        torsion: float | None = None,
        candidates: int | None = None,
        starts: int | None = None,
        seed: int | None = None,
        options: ExciteOptions | None = None,
    ) -> "ExcitedTrajectory":
        """Return an optimal trajectory for identification, within all limits.

        Args:
            harmonics: number of harmonics of each joint; 5 by default.
            period: length of the trajectory, s; 10 by default.
            criterion: "condition" (condition number of the scaled regressor, the default) or "d-optimal"
                (information).
            start: (n,) pose at its start and end, rad or m.
            share: part of every limit that may be used; 0.95 by default.
            workspace: file (.toml) of spheres and planes that bound the links.
            torsion: largest torsion of elastic joints, rad or m.
            candidates: number of random trajectories to start from and to compare with; 1000 by default.
            starts: how many of them are optimised; 10 by default.
            seed: of the random trajectories; 1 by default.
            options: all options, such as `symid.ExciteOptions(velocity=1.5)` for what the robot file does not
                limit; the arguments above take precedence.

        Raises:
            UsageError: an option is out of range or does not fit the robot.
            IdentifiabilityError: no such trajectory makes all parameters identifiable.

        Example:
            >>> import symid
            >>> found = symid.load("two_link").excite(harmonics=2, period=2, candidates=20, starts=1)
            >>> found.condition < found.product.random_condition
            True
        """
        import numpy as np

        from symid.api.experiment import ExcitedTrajectory

        order = merge(
            options,
            ExciteOptions(),
            harmonics=harmonics,
            period=period,
            criterion=criterion,
            start=start,
            share=share,
            workspace=workspace,
            torsion=torsion,
            candidates=candidates,
            starts=starts,
            seed=seed,
        )
        search, rng = (
            excitation.build_excitation_options(order, self.description),
            np.random.default_rng(order.seed),
        )
        found = excitation.optimise_excitation(self.description, search, rng=rng, progress=self.progress)
        return ExcitedTrajectory(robot=self.description, product=found, seed=order.seed)

    def simulate(
        self,
        trajectory: "str | PathLike[str] | ExcitedTrajectory | Trajectory | SampledMotion" = "fourier",
        *,
        duration: float | None = None,
        scale: float | None = None,
        noise: float | None = None,
        clean: bool | None = None,
        bandwidth: float | None = None,
        seed: int | None = None,
        options: SimulateOptions | None = None,
    ) -> "Simulation":
        """Simulate the robot under PD control along a trajectory; return the measured log.

        Args:
            trajectory: "fourier" (a random series), "ta" or "tb" (published), "tc" (for validation), a file,
                a result of `excite`, or a motion.
            duration: s; that of the trajectory where left out.
            scale: factor on the trajectory's amplitudes; 1 by default.
            noise: standard deviation of the torque sensors, N m or N; 0.05 by default, of an elastic robot
                2 % of each joint's RMS torque.
            clean: whether the sensors are perfect: no noise, no encoder steps.
            bandwidth: of the gains, which follow from the inertia of the joints, Hz; by default 12, or less
                where the loops would not be stable (a note says so), or the gains of the robot file.
            seed: of all random numbers; 1 by default.
            options: all options, such as `symid.SimulateOptions(control_period=0.002)`; the arguments above
                take precedence.

        Raises:
            UsageError: there is no such trajectory, or an option does not fit the robot.
            RobotError: the robot file does not state all values.
            SolverError: the controller does not hold the robot; the message names joints and options.

        Example:
            >>> import symid
            >>> run = symid.load("two_link").simulate("ta", duration=0.5)
            >>> run.q.shape, run.tau.shape
            ((501, 2), (501, 2))
        """
        import numpy as np

        from symid.api.experiment import ExcitedTrajectory, Simulation

        order = merge(
            options,
            SimulateOptions(),
            duration=duration,
            scale=scale,
            noise=noise,
            clean=clean,
            bandwidth=bandwidth,
            seed=seed,
        )
        robot = self.description
        simulation.check_sensor_options(robot, order)
        # Before minutes go into the derivation.
        simulation.check_stated_values(robot)
        rng = np.random.default_rng(order.seed)
        given = trajectory.trajectory if isinstance(trajectory, ExcitedTrajectory) else trajectory
        named = fspath(given) if isinstance(given, PathLike) else given
        motion = excitation.build_motion(
            robot, named, rng, duration=order.duration, joint=order.joint, scale=order.scale
        )
        library = self.library
        self.progress(f"simulating {motion.duration:g} s of {robot.name}")
        found = simulation.simulate_log(robot, library, motion, order, rng)
        return Simulation(
            robot=robot,
            recording=found.recording,
            trajectory=motion.source,
            duration=motion.duration,
            seed=order.seed,
            energy_gap=found.energy_gap,
            backend=found.backend,
            details=found.details,
            library_notices=library.notices,
        )

    # Payloads, and files for other programs.

    def payload(
        self,
        loaded: "PayloadSide",
        empty: "PayloadSide",
        *,
        joint: str | None = None,
        mass: float | None = None,
        rows: Literal["torque", "momentum"] = "torque",
        estimator: Literal["ols", "wls"] = "wls",
    ) -> "PayloadResult":
        """Identify mass, centre of mass and inertia of the payload: in `loaded`, but not in `empty`.

        A body fixed to a link changes the base parameters by K_link delta, where delta are its ten standard
        parameters. They are estimated by generalised least squares with the covariance of both sides, and
        moved to the nearest physically consistent body. Quantities that are not identifiable are refused.

        Args:
            loaded: with the payload: a fit, its file, or logs.
            empty: without it, likewise.
            joint: joint of the link that carries it; the last one by default.
            mass: kg, if it is known.
            rows: for logs: "torque" or "momentum" equations.
            estimator: for logs: "ols", or "wls", weighted by the noise of each joint.

        Raises:
            UsageError: a file is given twice, fits and logs are mixed, or there is no such joint.
            EstimateError: an estimate is of another model.
            LogError: a log cannot be used.
            IdentifiabilityError: no quantity of the payload is identifiable.

        Example:
            >>> import symid
            >>> from pathlib import Path
            >>> robot = symid.load("two_link")
            >>> heavy = robot.path.read_text().replace("mass = 1.9", "mass = 2.9")
            >>> Path("heavy.toml").write_text(heavy) == len(heavy)
            True
            >>> carrying = symid.load("heavy.toml").simulate(duration=4, seed=2).log
            >>> found = robot.payload(carrying, robot.simulate(duration=4).log)
            >>> round(found.mass, 1)
            1.0
        """
        from symid.api.identification import PayloadResult, list_payload_side

        options = PayloadOptions(joint=joint, mass=mass, rows=rows, estimator=estimator)
        sides = (list_payload_side(loaded), list_payload_side(empty))
        found = identification.identify_payload(self.description, *sides, options, self.context)
        return PayloadResult(product=found, carrier=self.description)

    def export(self, path: str | PathLike[str], *, precision: Precision = "double") -> "ExportedFile":
        """Write the robot with the values of its robot file; the suffix of `path` selects the format.

        Args:
            path: an existing file is overwritten: .toml, .urdf, .xml or .mjcf (MuJoCo), .usda, .h (C), .json.
            precision: of the numbers in a C header: that of the generated library.

        Raises:
            UsageError: the format is unknown, or has no precision.
            RobotError: the robot file does not state all values.
            OutputError: the file cannot be written.

        Example:
            >>> import symid
            >>> symid.load("two_link").export("two_link.urdf").format
            'URDF'
        """
        from symid.api.robot_files import ExportedFile

        self.progress(f"writing {self.name}")

        return ExportedFile(
            product=identification.write_stated(self.description, Path(path), precision=precision)
        )

    # Studies of methods on the robot, simulated.

    def study_precision(
        self, *, seeds: int = 400, seed: int = 1, jobs: int | None = None
    ) -> "Study[PrecisionStudy]":
        """Compare errors of identification with the Cramer-Rao bound, on five random excitations.

        Args:
            seeds: draws of the noise.
            seed: the first one.
            jobs: number of processes; one for each core by default. A script starts them below `if __name__
                == "__main__":`.

        Example:
            >>> import symid
            >>> study = symid.load("two_link").study_precision(seeds=2, jobs=1)
            >>> [method.method for method in study.product.methods]
            ['wls', 'momentum', 'consistent']
        """
        found = self._study(
            studies.study_precision, "precision of", report.show_precision, list_seeds(seeds, seed), jobs=jobs
        )
        return replace(found, notices=self.notices)

    def _study(
        self,
        study: Callable[..., Any],
        title: str,
        show: "Callable[[Any], tuple[Block, ...]]",
        numbers: range,
        **options: object,
    ) -> "Study[Any]":
        """Return a study with the noise of every seed in `numbers`, in several processes."""
        from symid.api.experiment import Study

        # Made here, with its progress told, before processes look for it.
        _ = self.library
        counted = report_count(self.progress)
        found = study(self.description, numbers, backend=self.backend, progress=counted, **options)
        title = f"{title} {self.name}"
        return Study(title=title, product=found, tables=show(found), described=asdict(found))

    def study_cutoff(self, log: "LogLike") -> "Study[CutoffStudy]":
        """Show how the cut-off of the position filter changes the prediction error of a fit.

        Args:
            log: of this robot, a file or one that was read.

        Raises:
            UsageError: the file lists several runs.
            LogError: the log is wrong.

        Example:
            >>> import symid
            >>> robot = symid.load("two_link")
            >>> study = robot.study_cutoff(robot.simulate(duration=6.0).log)
            >>> study.product.chosen > 0
            True
        """
        from symid.api.experiment import Study
        from symid.api.log import take_one_log

        robot = self.description
        recording = log_files.read_one_log(take_one_log(log), robot)
        rigid = elastic.build_rigid_variant(robot) if self.elastic else robot
        library = replace(self, description=rigid).library
        measured = elastic.build_motor_recording(recording, robot)
        found = studies.study_cutoff(
            library, measured, robot.processing, progress=report_count(self.progress)
        )
        return Study(
            title=f"cut-off of {robot.name}",
            product=found,
            tables=report.show_cutoff(found),
            described=asdict(found),
            notices=(*robot.notices, *recording.notices, *library.notices),
        )

    def study_elastic(
        self, *, seeds: int = 100, seed: int = 1, jobs: int | None = None, timed: bool = False
    ) -> "Study[ElasticStudy]":
        """Compare the methods for elastic joints on four sets of simulated logs, clean and noisy.

        Each of `seeds` draws of the noise takes half a minute; with `timed` the time of each method is
        measured, which differs from run to run. `seed` and `jobs` are those of `study_precision`.

        Raises:
            UsageError: the robot has not two joints, or its file states no truth.

        Example:
            >>> import symid
            >>> robot = symid.load("two_link_elastic")
            >>> study = robot.study_elastic(seeds=1)  # doctest: +SKIP
        """
        numbers, title = list_seeds(seeds, seed), "methods for the elastic joints of"
        show = report.show_elastic_study
        found = self._study(studies.study_elastic, title, show, numbers, jobs=jobs, timed=timed)
        return replace(found, described=report.describe_elastic_study(found.product, numbers))

    def study_tracking(
        self, *, seeds: int = 20, seed: int = 1, jobs: int | None = None
    ) -> "Study[TrackingStudy]":
        """Compare tracking errors of links with feed-forward of the identified model, another one, or none.

        `seeds` are draws of the noise of the logs that models are identified from; `seed` and `jobs` are
        those of `study_precision`.

        Raises:
            UsageError: the robot has not two joints, or its file states no truth.

        Example:
            >>> import symid
            >>> robot = symid.load("two_link_elastic")
            >>> study = robot.study_tracking(seeds=1)  # doctest: +SKIP
        """
        numbers = list_seeds(seeds, seed)
        return self._study(studies.study_tracking, "tracking of", report.show_tracking, numbers, jobs=jobs)

    def study_six_joints(self, *, seeds: int = 1, seed: int = 1) -> "Study[tuple[ManyJointsResult, ...]]":
        """Validate the identified dynamics of an elastic arm with any number of joints on a held-out motion.

        Args:
            seeds: draws of motion and noise.
            seed: the first one.

        Raises:
            UsageError: the robot file states no truth.

        Example:
            >>> import symid
            >>> robot = symid.load("puma560_elastic")
            >>> study = robot.study_six_joints()  # doctest: +SKIP
        """
        from symid.api.experiment import Study

        numbers, library = list_seeds(seeds, seed), self.library
        found = tuple(
            studies.study_many_joints(self.description, library, condition, number)
            for number in numbers
            for condition in studies.SensorCondition
        )
        return Study(
            title=f"dynamics of the elastic arm {self.name}",
            product=found,
            tables=tuple(map(report.show_many_joints, found)),
            described={"runs": [report.describe_many_joints(result) for result in found]},
            notices=tuple(dict.fromkeys(notice for result in found for notice in result.notices)),
        )


_ROUNDED = ("robot.angle-snapped", "robot.axis-snapped")


def load(
    robot: str | PathLike[str],
    *,
    settings: Settings | None = None,
    friction: str | None = None,
    base: str | None = None,
    tip: str | None = None,
    snap: float | None = None,
    convention: str | None = None,
    gravity: Sequence[float] | None = None,
    backend: str = "auto",
    progress: Progress = ignore,
) -> RobotModel:
    """Return the robot of a name or of a file.

    Args:
        robot: the path of a robot file (.toml), a URDF, an MJCF model (.xml, .mjcf) or a table of rows
            (.csv), or the name of a robot in ./robots or of those that come with symid.
        settings: replace those of the file: a set of the file by its name, or values by dotted key.
        friction: the friction law of all joints: "none", or one without shape values, such as
            "coulomb-viscous-offset".
        base: for a URDF or MJCF: first link of the robot; its root by default.
        tip: for a URDF or MJCF: last link of the robot; other branches are removed.
        snap: for a URDF or MJCF: angles within this distance (rad) of a quarter turn are rounded to it; by
            default 1e-5 where that changes no number of base parameters, else 0; a note says what it changes.
        convention: for a table of rows: "modified" or "standard" Denavit-Hartenberg; it is never guessed.
        gravity: for a table of rows: in the base frame, m/s^2; 0, 0, -9.81 by default.
        backend: what computes the functions: "auto", "c", "python" or "casadi".
        progress: called with a short text at each stage, for example `print`.

    Raises:
        UsageError: there is no such robot, or an option does not fit the file.
        RobotError: the file has mistakes; all are listed, each with its line and column.

    Example:
        >>> import symid
        >>> symid.load("panda").name
        'panda'
    """
    check_choice("backend", backend, BACKENDS)
    written = None
    if gravity is not None:
        if len(gravity) != 3 or not all(map(math.isfinite, gravity)):
            text = f"gravity {gravity!r}: expected three finite numbers in m/s^2, such as (0, 0, -9.81)"
            raise UsageError(Notice(code="usage.gravity", text=text))
        x, y, z = (repr(float(part)) for part in gravity)
        written = (x, y, z)
    read = partial(
        robots.load_robot,
        fspath(robot),
        list_pairs(settings),
        friction,
        base=base,
        tip=tip,
        convention=convention,
        gravity=written,
    )
    described = read(snap=snap)
    if snap is None and any(notice.code in _ROUNDED for notice in described.notices):
        # Loads SymPy: only where an angle was rounded.

        described = dynamics.choose_reading(read)
    return RobotModel(description=described, backend=backend, progress=progress)


def list_robots() -> tuple[str, ...]:
    """Return the names of the robots in ./robots and of those that come with symid.

    Example:
        >>> import symid
        >>> "panda" in symid.list_robots()
        True
    """
    return robots.list_robots()
