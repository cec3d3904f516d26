"""The result of an identification: parameters with their uncertainty, and what can be done with them.

Estimates, of now or from a file -> `RigidFit`, `ElasticFit`, `FrictionFit`, all of them a `Fit`.

    fit["ZZ2"].value, fit["ZZ2"].std    one parameter
    fit.validate("test.csv")            prediction of a held-out log
    fit.save("fit.json")                symid.load_fit("fit.json") reads it back
"""

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import nullcontext, suppress
from copy import deepcopy
from dataclasses import field, replace
from functools import cached_property
from os import PathLike, fspath
from pathlib import Path
from typing import Any, ClassVar, final

import numpy as np

from symid import codegen, identification, logs as log_files, report, robot as robots
from symid.api.dynamics import RobotDynamics
from symid.api.log import Log, LogLike, Logs, Part, Parts, Settings, list_logs, list_pairs, take_one_log
from symid.api.result import DrawnResult, JudgedResult, SavedResult
from symid.api.robot_files import ExportedFile, export_fit
from symid.api.validation import Comparison, DeviationUnit, FitDiagnosis, FitPage, LogValidation, compare_fit
from symid.arrays import FloatArray, freeze
from symid.errors import Notice, RobotError, UsageError
from symid.identification import elastic, estimators, friction, rigid
from symid.options import ExportOptions, Precision
from symid.serialization import describe_record


class Fit(JudgedResult, DrawnResult, SavedResult):
    """The result of an identification, of any kind.

    Attributes:
        estimate: the full result, with the settings used.
        file: where it was read from; None for a new fit.
        model: the robot, or what loads it by the name stored in the file.
        remarks: warnings and notes on the fit, its robot and its logs.
        extra: entries of `to_dict` that only a new fit has, such as the backend.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link")
        >>> fit = robot.identify(robot.simulate(duration=5.0, seed=1).log)
        >>> print(fit["Fv1"].unit)
        N m s/rad
        >>> symid.load_fit(fit.save("fit.json")).values == fit.values
        True
    """

    estimate: "estimators.Estimate | elastic.ElasticEstimate | friction.FrictionIdentification"
    file: Path | None = None
    model: RobotDynamics | Callable[[], RobotDynamics]
    remarks: tuple[Notice, ...] = ()
    extra: Mapping[str, object] = field(default_factory=dict)
    _of: ClassVar[str] = ""
    """What was identified, where torques cannot be compared in a band."""

    @property
    def product(self) -> "estimators.Estimate | elastic.ElasticEstimate | friction.FrictionIdentification":
        """Return the full result, as `estimate`."""
        return self.estimate

    @property
    @abstractmethod
    def parameters(self) -> "tuple[estimators.ParameterEstimate, ...]":
        """Return the identified parameters with value, standard deviation and unit."""

    @property
    @abstractmethod
    def residual(self) -> "tuple[estimators.Residual, ...]":
        """Return the residual of the fit on its own logs, joint by joint."""

    @cached_property
    def robot(self) -> RobotDynamics:
        """Return the robot; if none was given, it is loaded by the name stored in the fit.

        Raises:
            UsageError: there is no robot of this name.
        """
        if isinstance(self.model, RobotDynamics):
            return self.model
        name = self.product.robot
        try:
            return self.model()
        except UsageError as error:
            first = error.notices[0]
            if first.code != "usage.unknown-robot":
                raise
            text = f"the estimate was made with robot '{name}', which is not among the known robots; name "
            text += "its file with --robot FILE.toml, or symid.load_fit(file, symid.load(robot_file))"
            raise UsageError(replace(first, text=text)) from error

    @property
    def settings(self) -> Mapping[str, object]:
        """Return a copy of processing, log map and options, after overrides."""
        return deepcopy(dict(self.product.settings))

    @property
    def sources(self) -> tuple[str, ...]:
        """Return the logs of the fit."""
        return self.product.sources

    @property
    def refused(self) -> Mapping[str, str]:
        """Return the parameters or joints that are not identifiable, with the reason."""
        return dict(self.product.refused)

    @property
    def values(self) -> Mapping[str, float]:
        """Return the values of the parameters by name, SI units."""
        return {entry.name: entry.value for entry in self.parameters}

    @cached_property
    def verdict(self) -> "report.FitVerdict":
        """Return what the fit is worth by its own logs; held-out logs give a stronger verdict (`validate`).

        Its `level` is "good", "usable", "doubtful" or "wrong".
        """
        return report.judge_fit(self.product)

    def _name_file(self) -> str:
        return str(self.file or "")

    def _list_remarks(self) -> tuple[Notice, ...]:
        return self.remarks

    def _draw(self) -> "tuple[report.Drawing, ...]":
        return report.draw_fit(self.product)

    def __len__(self) -> int:
        """Return the number of identified parameters."""
        return len(self.parameters)

    def __iter__(self) -> Iterator[str]:
        """Yield the names of the parameters."""
        return (entry.name for entry in self.parameters)

    def __getitem__(self, name: str) -> "estimators.ParameterEstimate":
        """Return the parameter called `name`, with `.value`, `.std` and `.unit`.

        Raises:
            UsageError: it was refused, or does not exist; the message gives the reason, or the nearest names.
        """
        entries = {entry.name: entry for entry in self.parameters}
        if name in entries:
            return entries[name]
        if name in self.refused:
            text = f"{name!r} has no value: {self.refused[name]}"
        else:
            hint = robots.suggest_names(name, entries, otherwise="there are")
            text = f"{name!r} is not a parameter of this fit: {hint}"
        raise UsageError(Notice(code="usage.unknown-parameter", text=text))

    def _save(self, file: Path) -> Path:
        return identification.write_fit(self.estimate, file, verdict=describe_record(self.verdict))

    def validate(
        self,
        log: LogLike,
        *,
        test: Part | None = None,
        gate: float | None = None,
        settings: Settings | None = None,
        band: float | None = None,
    ) -> LogValidation:
        """Return the prediction error of the fit on a held-out log; nothing is fitted.

        Args:
            log: a file, or a log that was read.
            test: the part of the log to predict, such as "60%:" after `identify(..., train="0:60%")`, or two
                numbers in s from its first sample, None for an open end. A number without unit has the unit
                of `train`.
            gate: percent, limit of the mean relative residual of the joints.
            settings: replace those of the fit: a set of the robot file, or values by dotted key.
            band: Hz, of rigid fits: compare torques at the full sample rate, the measured one and the one
                predicted from the states of the fit, both after the same low-pass filter, without half a
                second at either end.

        Raises:
            UsageError: `band` is given, and the fit is not of base parameters.
            EstimateError: the fit belongs to another model.
            LogError: the log does not fit the robot.
            IdentifiabilityError: no joint moves in the log.
        """
        if band is not None and self._of:
            text = f"--band needs an estimate of base parameters, and this one is of {self._of}; leave it out"
            raise UsageError(Notice(code="usage.no-band", text=text, file=self._name_file()))
        return self._try(log, test, gate, settings, band=band)

    def read_logs(self, path: str | PathLike[str]) -> tuple[Log, ...]:
        """Return the logs of a file as the fit reads them: one, or several where time starts again.

        Args:
            path: a log, or a file with `[[run]]` tables, as `symid.read_logs` takes it.

        Raises:
            LogError: a log does not fit the robot; the message lists all mistakes.
        """
        described = rigid.restore_robot(self.robot.description, self.estimate)
        found = log_files.read_recordings((Path(path),), described)
        return tuple(Log(recording=recording, robot=described) for recording in found)

    def _try(
        self,
        log: LogLike,
        test: Part | None,
        gate: float | None,
        settings: Settings | None,
        *,
        band: float | None = None,
        tracking: "identification.TrackingTask | None" = None,
    ) -> LogValidation:
        pairs = list_pairs(settings)
        found = identification.validate_fit(
            self.robot.description,
            self.estimate,
            take_one_log(log, pairs),
            self.robot.context,
            pairs=pairs,
            test=self._list_test_parts(test),
            band=band,
            tracking=tracking,
            file=self._name_file(),
        )
        return LogValidation(product=found, gate=gate, estimate=self.estimate)

    def _list_test_parts(self, test: Parts | None) -> "tuple[log_files.LogPart, ...]":
        """Return parts to predict; a number without unit has that of the parts that were fitted."""
        return log_files.read_parts(test, "--test", log_files.get_train_unit(self.estimate.settings))

    def compare(
        self,
        *others: "Fit | str | PathLike[str]",
        name: str | None = None,
        value: str | None = None,
        deviation: str | None = None,
        deviation_unit: DeviationUnit | None = None,
        read_as: Mapping[str, str] | None = None,
        gate: float | None = None,
    ) -> Comparison:
        """Compare the values of the fit with others; differences in standard deviations of both sides.

        Args:
            others: fits of the same robot, their files, or tables (CSV) of published values in other
                groupings; ours are regrouped exactly.
            name: for a table: column of names or groups.
            value: for a table: column of values.
            deviation: for a table: column of standard deviations.
            deviation_unit: for a table: "absolute" or "percent"; taken from the column's name by default.
            read_as: for a table: groups to read as other sums, such as {"fv5": "fv5 + fvm6"}.
            gate: limit of the largest difference, in standard deviations.

        Raises:
            UsageError: a column is missing, or a reading is not a sum of our parameters.
            EstimateError: another fit cannot be read, belongs to another robot, or has nothing in common.
        """
        table: dict[str, Any] = {"name": name, "value": value, "deviation": deviation}
        table |= {"deviation_unit": deviation_unit, "read_as": read_as}
        robot, progress = self.robot.description, self.robot.progress
        return compare_fit(robot, self, others, **table, gate=gate, progress=progress)

    def export(
        self,
        path: str | PathLike[str] | None = None,
        *,
        precision: Precision = "double",
        name: str | None = None,
        accept: bool = False,
        limit: float | None = None,
        ratio: float | None = None,
    ) -> ExportedFile:
        """Write the robot with the values of the fit; the suffix of `path` selects the format.

        Among all physically consistent bodies with the identified combinations of masses and inertias, those
        nearest to the robot file are written; where no bodies have them, the nearest in the covariance of the
        fit. A `.urdf` is the robot's own with other numbers, where the robot was made from one.

        Args:
            path: .toml (robot file), .urdf, .xml or .mjcf (MuJoCo), .usda, .h (C) or .json; overwritten.
                None for the URDF or MJCF that the robot was made from, in place.
            precision: of the numbers in a C header: that of the generated library.
            name: how names in a C header begin, such as "tool_a"; by default that of the generated library.
            accept: write the file although the verdict on the fit is wrong.
            limit: percent of each joint's torque that the bodies may differ from the fit by; by default 2,
                or 0.14 times what the fit leaves of held-out torque where that is more.
            ratio: times that the torque of a joint may be larger or smaller than by the robot file's values,
                or larger than its limit; by default 3, and 1.5 for the limit.

        Raises:
            UsageError: the format is unknown, or cannot hold this fit; there is no URDF or MJCF.
            EstimateError: the format cannot represent these values, bodies differ by more than the limit,
                torques by more than the ratio, or the verdict is wrong.
            OutputError: the file cannot be written.
        """
        robot = self.robot
        options = ExportOptions(precision=precision, name=name, accept=accept, limit=limit, ratio=ratio)
        return export_fit(robot.description, self, path, options, robot.progress)

    def report(
        self,
        path: str | PathLike[str],
        *,
        validation: Logs = (),
        test: Parts | None = None,
        settings: Settings | None = None,
        diagnose: bool = False,
        title: str = "",
        author: str = "",
        date: str = "",
    ) -> FitPage:
        """Write a self-contained HTML page: verdict, parameters, torques, figures.

        Args:
            path: of the page.
            validation: held-out logs to predict.
            test: the part of these logs to predict, as for `validate`: one for all, or one for each.
            settings: for these logs, as for `validate`.
            diagnose: read the logs of the fit again for a diagnosis: correlations, bootstrap, drift,
                structure.
            title: of the page.
            author: below it.
            date: beside the author.

        Raises:
            UsageError: this kind of fit has no validation or diagnosis.
            LogError: a log does not fit the robot.
            OutputError: the page cannot be written.
        """
        pairs = list_pairs(settings)
        logs = list_logs(validation, pairs)
        known = None
        with nullcontext() if logs or diagnose else suppress(UsageError, RobotError):
            # A page of the stored fit alone draws the robot, where it is there.
            known = (self.robot.description, self.robot.context)
        page = report.write_fit_page(
            Path(fspath(path)),
            self.product,
            known,
            logs=logs,
            pairs=pairs,
            test=self._list_test_parts(test),
            diagnose=diagnose,
            file=self._name_file(),
            heading={"title": title, "author": author, "date": date},
        )
        return FitPage(page=page)

    def summarise(self) -> str:
        """Return robot, number of parameters, and mean relative residual."""
        left = sum(entry.relative_percent for entry in self.residual) / max(1, len(self.residual))
        return f"{self.product.robot}: {len(self)} parameters, mean relative residual {left:.4g} %"


class _DynamicsFit(Fit):
    """Parameters of the dynamics, with their covariance."""

    estimate: "estimators.Estimate | elastic.ElasticEstimate"

    @property
    def parameters(self) -> "tuple[estimators.ParameterEstimate, ...]":
        """Return the identified base and friction parameters; for elastic joints also rotor inertias."""
        return self.estimate.parameters

    @property
    def residual(self) -> "tuple[estimators.Residual, ...]":
        """Return the residual of the fit on its own logs, joint by joint."""
        return self.estimate.residual

    @property
    def beta(self) -> FloatArray:
        """Return the base parameters in the order of compiled functions: (b,), SI units.

        Raises:
            UsageError: one of them was not identified, or the joints of an elastic robot were taken as rigid.
            EstimateError: the robot file has other bodies on fixed joints than when the fit was made.
        """
        values, robot = self._list_values(self.robot.base.names), self.robot.description
        if robot.fixed or "fixed" in self.estimate.settings:
            card = codegen.build_model_card(robot, self.robot.base.product, ())
            estimators.check_bodies(self.estimate, robot, card, self._name_file())
        return values

    @property
    def f(self) -> FloatArray:
        """Return the friction parameters in the order of compiled functions: (p,), SI units.

        Raises:
            UsageError: as for `beta`.
        """
        return self._list_values(self.robot.base.friction)

    def _list_values(self, names: tuple[str, ...]) -> FloatArray:
        values = self.values
        missing = [name for name in names if name not in values]
        if self.robot.elastic and isinstance(self, RigidFit):
            text = "the fit takes the joints as rigid; elastic robots group rotors differently"
        elif missing:
            text = f"{', '.join(missing)} not identified; excite more, or use `fit.values`"
        else:
            return np.array([values[name] for name in names])
        raise UsageError(Notice(code="usage.no-vector", text=text))

    @property
    def covariance(self) -> FloatArray:
        """Return the covariance of the parameters: (p, p); (0, 0) if the method has none."""
        rows = self.estimate.covariance
        return freeze(np.array(rows, dtype=float).reshape(len(rows), len(rows)))


@final
class RigidFit(_DynamicsFit):
    """Base parameters and friction of a robot with rigid joints, or with joints taken as rigid.

    Attributes:
        estimate: the full result, with the settings used.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link")
        >>> fit = robot.identify(robot.simulate(duration=5.0, seed=1).log)
        >>> len(fit), fit.covariance.shape
        (12, (12, 12))
    """

    estimate: "estimators.Estimate"

    def diagnose(self) -> FitDiagnosis:
        """Diagnose the fit with its own logs: correlations, bootstrap, drift, structure of the residual.

        Raises:
            LogError: a log no longer exists.
            UsageError: the rows of the fit mix the joints.
        """
        found = identification.diagnose_fit(self.robot.description, self.estimate, self.robot.context)
        return FitDiagnosis(robot=self.estimate.robot, product=found)

    def blocks(self) -> "tuple[report.Block, ...]":
        """Return a headline, and tables of parameters and residuals."""
        return report.texts.show_estimate(self.estimate)

    def brief(self) -> "tuple[report.Block, ...]":
        """Return the tables without the residual of all rows, where there is a better one."""
        return report.texts.show_estimate(self.estimate, brief=True)

    def _describe(self) -> dict[str, object]:
        return {**report.texts.describe_estimate(self.estimate), **self.extra}


@final
class ElasticFit(_DynamicsFit):
    """Dynamics, friction and springs with hysteresis of a robot whose joints are elastic.

    Attributes:
        estimate: the full result, with the settings used.
        alignment: delay and offsets of the link encoders; None if they were not estimated.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link_elastic")
        >>> fit = robot.identify(robot.simulate(duration=4.0, seed=1).log, method="two-step")
        >>> [spring.joint for spring in fit.springs]
        ['shoulder', 'elbow']
    """

    estimate: "elastic.ElasticEstimate"
    alignment: "log_files.Alignment | None" = None
    _of = "elastic joints"

    @property
    def springs(self) -> "tuple[elastic.SpringEstimate, ...]":
        """Return the spring of every joint; empty if the method gives none."""
        return self.estimate.springs

    def track(
        self,
        log: LogLike,
        *,
        against: "Sequence[ElasticFit]" = (),
        seed: int | None = None,
        test: Part | None = None,
        gate: float | None = None,
        settings: Settings | None = None,
    ) -> LogValidation:
        """Validate, and simulate the tracking of another motion with feed-forward of the fit.

        `log`, `test`, `gate` and `settings` are those of `validate`; `against` are further fits to compare
        with, and `seed` is that of a random motion, None for the standard validation motion.

        Raises:
            RobotError: the robot file does not state the true values.
            UsageError: a fit lacks springs, which a feed-forward needs.
        """
        others = tuple((str(entry.file or ""), entry.estimate) for entry in against)
        task = identification.build_tracking_task(self.robot.description, seed, others)
        return self._try(log, test, gate, settings, tracking=task)

    def blocks(self) -> "tuple[report.Block, ...]":
        """Return a headline, the reason for the method, parameters, springs and residuals."""
        return report.texts.show_elastic(self.estimate)

    def _describe(self) -> dict[str, object]:
        joints, aligned = [entry.joint for entry in self.estimate.residual], None
        if self.alignment is not None:
            aligned = report.texts.describe_alignment(self.alignment, joints)
        return {**report.texts.describe_elastic(self.estimate), "alignment": aligned, **self.extra}


@final
class FrictionFit(Fit):
    """A friction law and its parameters for every joint that moves.

    Attributes:
        estimate: the full result, with the settings used.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link")
        >>> log = robot.simulate(duration=5.0, seed=1).log
        >>> fit = robot.identify_friction(log, model="coulomb-viscous-offset")
        >>> list(fit)[:3]
        ['shoulder.fC', 'shoulder.fV', 'shoulder.offset']
        >>> round(fit["elbow.fC"].value, 1)
        0.9
    """

    estimate: "friction.FrictionIdentification"
    _of = "a law of friction"

    @property
    def joints(self) -> "Mapping[str, friction.JointFriction]":
        """Return the result of every joint by its name."""
        return {entry.joint: entry for entry in self.estimate.joints}

    @property
    def parameters(self) -> "tuple[estimators.ParameterEstimate, ...]":
        """Return the parameters of all laws, called joint.parameter, such as "elbow.fC"."""
        pairs = (
            (joint.joint, entry) for joint in self.estimate.joints for entry in joint.estimate.parameters
        )
        return tuple(replace(entry, name=f"{joint}.{entry.name}") for joint, entry in pairs)

    @property
    def refused(self) -> Mapping[str, str]:
        """Return the joints and parameters that are not identifiable, with the reason."""
        found = dict(self.estimate.refused)
        for joint in self.estimate.joints:
            found |= {f"{joint.joint}.{name}": reason for name, reason in joint.estimate.refused}
        return found

    @property
    def residual(self) -> "tuple[estimators.Residual, ...]":
        """Return the residual of each law on its own logs."""
        return tuple(entry.residual for entry in self.estimate.joints)

    def summarise(self) -> str:
        """Return robot, joints and laws."""
        laws = ", ".join(f"{name}: {entry.estimate.law}" for name, entry in self.joints.items())
        return f"{self.estimate.robot}: {laws}"

    def blocks(self) -> "tuple[report.Block, ...]":
        """Return choice, law, parameters and residual of every joint."""
        return report.texts.show_friction(self.estimate)

    def brief(self) -> "tuple[report.Block, ...]":
        """Return the law and the values of each joint."""
        return report.texts.list_friction(self.estimate)

    def _describe(self) -> dict[str, object]:
        return {**report.texts.describe_friction(self.estimate), **self.extra}


def build_dynamics_fit(
    found: "identification.Identification[estimators.Estimate | elastic.ElasticEstimate]",
    robot: RobotDynamics,
) -> RigidFit | ElasticFit:
    """Return the fit of an identification of this robot."""
    facts: dict[str, Any] = {"model": robot, "remarks": found.notices, "extra": {"backend": found.backend}}
    if isinstance(found.estimate, elastic.ElasticEstimate):
        return ElasticFit(estimate=found.estimate, alignment=found.alignment, **facts)
    return RigidFit(estimate=found.estimate, **facts)
