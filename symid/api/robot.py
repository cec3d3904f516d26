"""The robot of the API: a description with everything that can be done with it.

Name or path of a robot file -> `RobotModel`, whose methods are named as the verbs are.

    robot = symid.load("panda")
    robot.base                      its base parameters, exactly
    robot.sympy("mass_matrix")      exact expressions; robot.casadi(...) the same as a CasADi function
    robot.identify(["train.csv"])   parameters from logs

Supported: robot files, URDF, MJCF, tables of Denavit-Hartenberg rows. Nothing heavy is loaded before use.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import chain
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Literal, TypeAlias, final

import numpy as np

from symid import (
    dynamics,
    excitation,
    identification,
    logs as log_files,
    report,
    robot as robots,
    simulation,
    study as studies,
)
from symid.api import log as api_logs
from symid.api.dynamics import RobotDynamics
from symid.api.experiment import ExcitedTrajectory, Simulation, Study, list_seeds
from symid.api.fit import ElasticFit, Fit, FrictionFit, RigidFit, build_dynamics_fit
from symid.api.identification import OneShotProblem, PayloadResult, PayloadSide, Stiffness, list_payload_side
from symid.api.result import Figures, Progress, ignore
from symid.api.robot_files import ExportedFile
from symid.codegen import BACKENDS
from symid.environment import report_count
from symid.errors import Notice, UsageError
from symid.identification import elastic, friction as friction_fits, rigid as rigid_fits
from symid.options import (
    ExciteOptions,
    ExportOptions,
    PayloadOptions,
    Precision,
    SimulateOptions,
    check_value,
    merge,
    words,
)
from symid.serialization import describe_record

FollowedMotion: TypeAlias = (
    "str | PathLike[str] | ExcitedTrajectory | excitation.Trajectory | excitation.SampledMotion"
)


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RobotModel(RobotDynamics):
    """A robot with everything that can be done with it; made by `symid.load`.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link")
        >>> [joint.name for joint in robot.joints], robot.elastic
        (['shoulder', 'elbow'], False)
    """

    # Logs.

    def check(
        self, *logs: api_logs.LogLike, resample: str | PathLike[str] | None = None
    ) -> api_logs.RobotCheck:
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
        """
        if resample is not None and len(logs) != 1:
            text = f"resample (--resample): a copy is made of one log at a time, got {len(logs)}"
            raise UsageError(Notice(code="usage.one-log", text=text))
        found = rigid_fits.LogsCheck()
        if logs:
            found = rigid_fits.check_robot_logs(
                self.description,
                api_logs.list_logs(logs),
                prepare=lambda: self.library,
                progress=self.progress,
                output=None if resample is None else Path(fspath(resample)),
            )
        return api_logs.RobotCheck(robot=self.description, product=found)

    def plot(self, what: api_logs.LogLike | None = None, *, pose: Sequence[float] | None = None) -> Figures:
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
        robot = self.description
        if what is None:
            return Figures(drawings=(report.drawings.draw_robot(robot, pose),))
        if pose is not None:
            text = "pose is of the robot, and here a file is drawn; leave one of them out"
            raise UsageError(Notice(code="usage.pose", text=text))
        if isinstance(what, str | PathLike):
            path = Path(fspath(what))
            if path.suffix.lower() == ".json":
                return load_fit(path, self).plot()
            if excitation.is_trajectory(path):
                motion = excitation.read_trajectory(path, robot)
                return Figures(drawings=report.drawings.draw_motion(motion, robot))
        read = log_files.read_recordings(api_logs.list_logs((what,)), robot, uneven=True)
        logs = [rigid_fits.summarise_log(recording, robot) for recording in read]
        drawn = (report.drawings.draw_log(log.recording, robot, log) for log in logs)
        return Figures(drawings=tuple(chain.from_iterable(drawn)))

    # Identification.

    def identify(
        self,
        logs: api_logs.Logs,
        *,
        train: api_logs.Parts | None = None,
        rows: str | None = None,
        estimator: str | None = None,
        method: str | None = None,
        friction: str | Mapping[str, str] | None = None,
        settings: api_logs.Settings | None = None,
        cutoff: float | None = None,
        decimate: int | None = None,
        period: float | Sequence[float] | None = None,
        known: "Fit | RobotModel | str | PathLike[str] | Mapping[str, float] | None" = None,
        partial: bool | None = None,
        options: identification.IdentifyOptions | None = None,
    ) -> RigidFit | ElasticFit:
        """Identify base parameters and friction from logs; for elastic joints also springs and hysteresis.

        Robot and logs decide the model: rigid; elastic, if joints are elastic and the logs have positions of
        motors and links; otherwise the motor side alone.

        `logs` are files, files of runs, or logs that were read, and `train` the part of them to fit, such as
        "0:60%", or two numbers in s from the first sample, None for an open end; one for all, or a list of
        one for each. `friction` is the law of all joints, in place of the robot file's, its shape values
        found from the logs; "auto" for the law of each joint that predicts held-out torque best; or laws of
        single joints, such as {"elbow": "stribeck", "wrist": "auto"}. `settings` replace those of the robot
        file: a set by its name, or values by dotted key. `known` are, for elastic joints, dynamics that are
        not identified: a robot with values (such as those of CAD) or its file (.toml, .urdf, .xml), its links
        and the rotors whose inertia it states; a fit of this robot or its file; or parameters by name, in SI
        units. `rows`, `estimator`, `method`, `cutoff`, `decimate`, `period` and `partial` are those of
        `symid.IdentifyOptions`, of which `options` has all; these arguments take precedence.

        Raises:
            UsageError: options that do not go together, or not with this robot and these logs.
            LogError: a log cannot be read or used; the message lists all mistakes.
            EstimateError: `prior`, `start` or `known` is of another model, or its robot lacks values.
            IdentifiabilityError: too few parameters are identifiable; the message names the others.
            SolverError: a search ended without a usable result.
        """
        given: dict[str, object] = {"rows": rows, "estimator": estimator, "method": method, "known": known}
        given |= {"friction": friction, "cutoff": cutoff, "decimate": decimate}
        given |= {"period": period, "partial": partial}
        order = merge(options, identification.IdentifyOptions(), **given)
        rigid_fits.check_estimator(order.rows or "torque", order.estimator)
        law = identification.read_joint_laws(order.friction, self.description)
        searched = law if identification.needs_search(law) else None
        stated = law if isinstance(law, str) and not searched else None
        pairs = api_logs.list_pairs(settings, order)
        control = order.estimator in rigid_fits.SIMULATING
        described, recordings = self._gather(logs, pairs, stated, train, control=control)
        options = replace(order, friction=searched)
        named = stated is not None
        found = identification.identify_robot(
            described, recordings, options, self.context, pairs, named=named
        )
        return build_dynamics_fit(found, self)

    def _gather(
        self,
        logs: api_logs.Logs,
        pairs: tuple[tuple[str, str], ...],
        friction: str | None,
        train: api_logs.Parts | None,
        *,
        control: bool = False,
    ) -> "tuple[robots.Robot, tuple[log_files.Recording, ...]]":
        """Return the robot with the settings of the call, and what it fits of the recordings.

        The channels of the controller, which take memory, are kept for estimators that simulate it.
        """
        given = api_logs.list_logs(logs, pairs)
        described = robots.override_settings(api_logs.adopt_log_map(self.description, logs), pairs, friction)
        parts = log_files.read_parts(train, "--train")
        read = log_files.read_fit_recordings(given, described, control=control)
        return described, log_files.take_parts(read, parts, "--train", keep=True)

    def identify_friction(
        self,
        logs: api_logs.Logs,
        *,
        train: api_logs.Parts | None = None,
        model: str | Mapping[str, str] | None = None,
        estimator: str | None = None,
        known: "Fit | RobotModel | str | PathLike[str] | None" = None,
        smoothing: float | None = None,
        period: float | Sequence[float] | None = None,
        friction: str | None = None,
        settings: api_logs.Settings | None = None,
        options: identification.LawOptions | None = None,
    ) -> FrictionFit:
        """Identify a friction law and its parameters for every joint that moves.

        `logs`, `train` and `settings` are those of `identify`. `model` is a law, such as "stribeck+offset",
        or "auto" (the default): chosen on held-out data; or laws of single joints by name, chosen for the
        others. `known` are base parameters to subtract: a fit or its file, or a robot with values (such as
        those of CAD) or its file, .toml, .urdf or .xml; otherwise the rigid part is fitted too, with the law
        `friction` in place of the robot file's. `estimator`, `smoothing` and `period` are those of
        `symid.LawOptions`, of which `options` has all; these arguments take precedence.

        Raises:
            UsageError: there is no such law or estimator.
            EstimateError: `known` is of another model, or its robot lacks values.
            LogError: a log cannot be read or used.
            IdentifiabilityError: no joint has an identifiable law.
            SolverError: a search ended without usable numbers.
        """
        given: dict[str, object] = {"model": model, "estimator": estimator, "known": known}
        given |= {"friction": friction, "smoothing": smoothing, "period": period}
        order = merge(options, identification.LawOptions(), **given)
        parts = self._gather(logs, api_logs.list_pairs(settings, order), order.friction, train)
        found = identification.identify_robot_friction(*parts, order, self.context)
        extra = {"backend": found.backend}
        return FrictionFit(estimate=found.estimate, model=self, remarks=found.notices, extra=extra)

    def identify_stiffness(
        self,
        logs: api_logs.Logs,
        *,
        train: api_logs.Parts | None = None,
        friction: str | None = None,
        settings: api_logs.Settings | None = None,
        drop_first: int | None = None,
        drop_last: int | None = None,
    ) -> Stiffness:
        """Identify delay and offsets of the encoders, and the stiffness of every joint, with intervals.

        The `logs` have the positions of motors and links, of any robot. `train`, `friction`, `settings`,
        `drop_first` and `drop_last` are those of `identify`.

        Raises:
            UsageError: a setting has no meaning for a stiffness.
            LogError: a log lacks an encoder, or is too short.
        """
        cuts = identification.IdentifyOptions(drop_first=drop_first, drop_last=drop_last)
        pairs = api_logs.list_pairs(settings, cuts)
        described, recordings = self._gather(logs, pairs, friction, train)
        found, notices = identification.identify_stiffness(described, recordings, pairs, self.context)
        return Stiffness(estimate=found, notices=notices)

    def one_shot(
        self,
        logs: api_logs.Logs,
        *,
        train: api_logs.Parts | None = None,
        settings: api_logs.Settings | None = None,
        options: identification.IdentifyOptions | None = None,
    ) -> OneShotProblem:
        """Return the problem of the method "nlp" as CasADi expressions, open to terms and constraints.

        The problem is that of the last round, and starts at the fit. `logs`, `train`, `settings` and
        `options` are those of `identify`.

        Raises:
            UsageError: no joint is elastic, or a setting does not apply.
            LogError: a log lacks an encoder, or cannot be used.
            IdentifiabilityError: no spring is identifiable.
        """
        order = options or identification.IdentifyOptions()
        pairs = api_logs.list_pairs(settings, order)
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
    ) -> ExcitedTrajectory:
        """Return an optimal trajectory for identification, within all limits.

        `harmonics`, `period`, `criterion`, `start`, `share`, `workspace`, `torsion`, `candidates`, `starts`
        and `seed` are those of `symid.ExciteOptions`, of which `options` has all, such as the `velocity` that
        holds where the robot file states none; these arguments take precedence.

        Raises:
            UsageError: an option is out of range or does not fit the robot.
            IdentifiabilityError: no such trajectory makes all parameters identifiable.
        """
        given: dict[str, object] = {"harmonics": harmonics, "period": period, "criterion": criterion}
        given |= {"start": start, "share": share, "workspace": workspace, "torsion": torsion}
        given |= {"candidates": candidates, "starts": starts, "seed": seed}
        order = merge(options, ExciteOptions(), **given)
        rng = np.random.default_rng(order.seed)
        found = excitation.optimise_excitation(self.description, order, rng=rng, progress=self.progress)
        return ExcitedTrajectory.extend(
            found, robot=self.description, seed=order.seed, notices=(*self.notices, *found.notices)
        )

    def simulate(
        self,
        trajectory: "FollowedMotion" = "fourier",
        *,
        duration: float | None = None,
        scale: float | None = None,
        noise: float | None = None,
        clean: bool | None = None,
        bandwidth: float | None = None,
        seed: int | None = None,
        options: SimulateOptions | None = None,
    ) -> Simulation:
        """Simulate the robot under PD control along a trajectory; return the measured log.

        `trajectory` is "fourier" (a random series), "ta" or "tb" (published), "tc" (for validation), a file,
        a result of `excite`, or a motion. `duration`, `scale`, `noise`, `clean`, `bandwidth` and `seed` are
        those of `symid.SimulateOptions`, of which `options` has all; these arguments take precedence.

        Raises:
            UsageError: there is no such trajectory, or an option does not fit the robot.
            RobotError: the robot file does not state all values.
            SolverError: the controller does not hold the robot; the message names joints and options.
        """
        given: dict[str, object] = {"duration": duration, "scale": scale, "noise": noise, "clean": clean}
        order = merge(options, SimulateOptions(), **given, bandwidth=bandwidth, seed=seed)
        robot = self.description
        simulation.check_sensor_options(robot, order)
        # Before minutes go into the derivation.
        simulation.check_stated_values(robot)
        rng = np.random.default_rng(order.seed)
        named = trajectory.trajectory if isinstance(trajectory, ExcitedTrajectory) else trajectory
        named = fspath(named) if isinstance(named, PathLike) else named
        motion = excitation.build_motion(
            robot, named, rng, duration=order.duration, joint=order.joint, scale=order.scale
        )
        library = self.library
        self.progress(f"simulating {motion.duration:g} s of {robot.name}")
        found, details = simulation.simulate_log(robot, library, motion, order, rng)
        return Simulation(
            robot=robot,
            recording=found.recording,
            trajectory=motion.source,
            duration=motion.duration,
            seed=order.seed,
            energy_gap=found.energy_gap,
            backend=found.backend,
            details=details,
            library_notices=library.notices,
        )

    # Payloads, and files for other programs.

    def payload(
        self,
        loaded: PayloadSide,
        empty: PayloadSide,
        *,
        joint: str | None = None,
        mass: float | None = None,
        rows: Literal["torque", "momentum"] = "torque",
        estimator: Literal["ols", "wls"] = "wls",
    ) -> PayloadResult:
        """Identify mass, centre of mass and inertia of the payload: in `loaded`, but not in `empty`.

        A body fixed to a link changes the base parameters by K_link delta, where delta are its ten standard
        parameters. They are estimated by generalised least squares with the covariance of both sides, and
        moved to the nearest physically consistent body. Quantities that are not identifiable are refused.

        `loaded` and `empty` are each a fit, its file, or logs. The link with the payload is that of `joint`,
        the last one by default, and `mass` its mass in kg, if it is known. Of logs the `rows` are equations
        of torque or momentum, and the `estimator` "ols", or "wls", weighted by the noise of each joint.

        Raises:
            UsageError: a file is given twice, fits and logs are mixed, or there is no such joint.
            EstimateError: an estimate is of another model.
            LogError: a log cannot be used.
            IdentifiabilityError: no quantity of the payload is identifiable.
        """
        options = PayloadOptions(joint=joint, mass=mass, rows=rows, estimator=estimator)
        sides = (list_payload_side(loaded), list_payload_side(empty))
        found = identification.identify_payload(self.description, *sides, options, self.context)
        return PayloadResult(product=found, carrier=self.description)

    def export(
        self, path: str | PathLike[str], *, precision: Precision = "double", name: str | None = None
    ) -> ExportedFile:
        """Write the robot with the values of its robot file; the suffix of `path` selects the format.

        Args:
            path: an existing file is overwritten: .toml, .urdf, .xml or .mjcf (MuJoCo), .usda, .h (C), .json.
            precision: of the numbers in a C header: that of the generated library.
            name: how names in a C header begin, such as "tool_a"; by default that of the generated library.

        Raises:
            UsageError: the format is unknown, or has no precision or names.
            RobotError: the robot file does not state all values.
            OutputError: the file cannot be written.
        """
        self.progress(f"writing {self.name}")
        written = identification.write_stated(
            self.description, Path(path), ExportOptions(precision=precision, name=name)
        )
        return ExportedFile(product=written)

    # Studies of methods on the robot, simulated.

    def study_precision(
        self, *, seeds: int = 400, seed: int = 1, jobs: int | None = None
    ) -> "Study[studies.PrecisionStudy]":
        """Compare errors of identification with the Cramer-Rao bound, on five random excitations.

        Args:
            seeds: draws of the noise.
            seed: the first one.
            jobs: number of processes; one for each core by default. A script starts them below `if __name__
                == "__main__":`.
        """
        numbers, show = list_seeds(seeds, seed), report.study_text.show_precision
        found = self._study(studies.study_precision, "precision of", show, numbers, jobs=jobs)
        return replace(found, notices=self.notices)

    def _study(
        self,
        study: Callable[..., Any],
        title: str,
        show: "Callable[[Any], tuple[report.Block, ...]]",
        numbers: range,
        **options: object,
    ) -> "Study[Any]":
        """Return a study with the noise of every seed in `numbers`, in several processes."""
        # Made here, with its progress told, before processes look for it.
        _ = self.library
        counted = report_count(self.progress)
        found = study(self.description, numbers, backend=self.backend, progress=counted, **options)
        title = f"{title} {self.name}"
        return Study(title=title, product=found, tables=show(found), described=asdict(found))

    def study_cutoff(self, log: api_logs.LogLike) -> "Study[studies.CutoffStudy]":
        """Show how the cut-off of the position filter changes the error of a fit to a `log` or its file.

        Raises:
            UsageError: the file lists several runs.
            LogError: the log is wrong.
        """
        robot = self.description
        recording = log_files.read_one_log(api_logs.take_one_log(log), robot)
        rigid = elastic.build_rigid_variant(robot) if self.elastic else robot
        library = replace(self, description=rigid).library
        measured = elastic.build_motor_recording(recording, robot)
        counted = report_count(self.progress)
        found = studies.study_cutoff(library, measured, robot.processing, progress=counted)
        return Study(
            title=f"cut-off of {robot.name}",
            product=found,
            tables=report.study_text.show_cutoff(found),
            described=asdict(found),
            notices=(*robot.notices, *recording.notices, *library.notices),
        )

    def study_elastic(
        self, *, seeds: int = 100, seed: int = 1, jobs: int | None = None, timed: bool = False
    ) -> "Study[studies.elastic_methods.ElasticStudy]":
        """Compare the methods for elastic joints on four sets of simulated logs, clean and noisy.

        Each of `seeds` draws of the noise takes half a minute; with `timed` the time of each method is
        measured, which differs from run to run. `seed` and `jobs` are those of `study_precision`.

        Raises:
            UsageError: the robot has not two joints, or its file states no truth.
        """
        numbers, title = list_seeds(seeds, seed), "methods for the elastic joints of"
        study, show = studies.elastic_methods.study_elastic, report.study_text.show_elastic_study
        found = self._study(study, title, show, numbers, jobs=jobs, timed=timed)
        return replace(found, described={**describe_record(found.product), "seeds": list(numbers)})

    def study_tracking(
        self, *, seeds: int = 20, seed: int = 1, jobs: int | None = None
    ) -> "Study[studies.elastic_methods.TrackingStudy]":
        """Compare tracking errors of links with feed-forward of the identified model, another one, or none.

        `seeds` are draws of the noise of the logs that models are identified from; `seed` and `jobs` are
        those of `study_precision`.

        Raises:
            UsageError: the robot has not two joints, or its file states no truth.
        """
        study, show = studies.elastic_methods.study_tracking, report.study_text.show_tracking
        return self._study(study, "tracking of", show, list_seeds(seeds, seed), jobs=jobs)

    def study_six_joints(
        self, *, seeds: int = 1, seed: int = 1
    ) -> "Study[tuple[studies.elastic_methods.ManyJointsResult, ...]]":
        """Validate the identified dynamics of an elastic arm with any number of joints on a held-out motion.

        `seeds` are draws of motion and noise, and `seed` is the first one.

        Raises:
            UsageError: the robot file states no truth.
        """
        numbers, library = list_seeds(seeds, seed), self.library
        found = tuple(
            studies.elastic_methods.study_many_joints(self.description, library, condition, number)
            for number in numbers
            for condition in studies.elastic_methods.SensorCondition
        )
        return Study(
            title=f"dynamics of the elastic arm {self.name}",
            product=found,
            tables=tuple(map(report.study_text.show_many_joints, found)),
            described={"runs": [describe_record(result) for result in found]},
            notices=tuple(dict.fromkeys(notice for result in found for notice in result.notices)),
        )


_ROUNDED = ("robot.angle-rounded", "robot.angle-snapped", "robot.axis-snapped")


def load(
    robot: str | PathLike[str],
    *,
    settings: api_logs.Settings | None = None,
    friction: str | None = None,
    base: str | None = None,
    tip: str | None = None,
    snap: float | None = None,
    xacro: Mapping[str, str] | Sequence[str] = (),
    include_outside: bool = False,
    convention: str | None = None,
    gravity: robots.Vector | None = None,
    zeros: str | Sequence[str] | None = None,
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
            default 1e-5, and more for angles of few digits (1.57) where base parameters would hang on these;
            a note says what it changes. 0 moves nothing.
        xacro: arguments of a xacro file: their values by name, or texts such as "prefix:=left_".
        include_outside: for an MJCF model: read files that it includes from other folders than its own, too.
        convention: for a table of rows: "modified" or "standard" Denavit-Hartenberg; it is never guessed.
        gravity: in the base frame, m/s^2, in place of the file's, or "unknown": `identify` finds it.
        zeros: joints whose zeros `identify` finds, by name, or "unknown" for all.
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
    check_value("backend", backend, words(*BACKENDS))
    replaced = api_logs.list_pairs(settings), friction
    given: dict[str, Any] = {"base": base, "tip": tip, "convention": convention, "gravity": gravity}
    given |= {"xacro": xacro, "include_outside": include_outside, "zeros": zeros}
    read = partial(robots.load_robot, fspath(robot), *replaced, **given)
    described = read(snap=snap)
    if snap is None and any(notice.code in _ROUNDED for notice in described.notices):
        # Loads SymPy: only where an angle was rounded.
        described = dynamics.choose_reading(read)
    return RobotModel(description=described, backend=backend, progress=progress)


def load_fit(
    path: str | PathLike[str], robot: RobotModel | None = None, *, progress: Progress = ignore
) -> Fit:
    """Return the fit of any kind that `Fit.save` or `symid identify -o` wrote to `path`.

    By default its `robot` is loaded on use by the name or file stored in it, which `progress` reports.

    Raises:
        EstimateError: the file does not exist, or is not a fit.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link")
        >>> fit = robot.identify(robot.simulate(duration=5.0, seed=1).log)
        >>> symid.load_fit(fit.save("fit.json"))["ZZ2"] == fit["ZZ2"]
        True
    """
    file = Path(fspath(path))
    estimate = identification.read_fit(file)
    kinds: dict[type, type[Fit]] = {friction_fits.FrictionIdentification: FrictionFit}
    kinds[elastic.ElasticEstimate] = ElasticFit
    # The robot file as it was named, or moved along with the fit.
    own, near = Path(estimate.file), file.parent / Path(estimate.file).name
    name = (near if near.is_file() and not own.exists() else own) if estimate.file else estimate.robot
    model = robot or partial(load, name, progress=progress)
    kind = kinds.get(type(estimate), RigidFit)
    return kind(estimate=estimate, file=file, model=model, remarks=estimate.notices)


def list_robots() -> tuple[str, ...]:
    """Return the names of the robots in ./robots and of those that come with symid.

    Example:
        >>> import symid
        >>> "panda" in symid.list_robots()
        True
    """
    return robots.list_robots()
