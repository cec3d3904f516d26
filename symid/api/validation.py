"""Tests of a fit: a held-out log, its own logs again, values of others; and its page.

Validation -> `LogValidation`: residuals, a gate, figures; diagnosis -> `FitDiagnosis`; page -> `FitPage`;
estimate, other estimates or tables of values -> `Comparison`, group by group.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Literal, final

from symid import identification, report, robot as robots
from symid.api.result import DrawnResult, JudgedResult, PagedResult, Progress, Result, ignore
from symid.environment import show_path
from symid.errors import Notice, UsageError
from symid.identification import estimators, rigid
from symid.options import ABOVE, check_value
from symid.serialization import describe_record


@final
class LogValidation(JudgedResult, DrawnResult):
    """Prediction error of a fit on a held-out log.

    Attributes:
        product: the full result, with notices, for example that the log belongs to the fit.
        gate: percent, limit of the mean relative residual; None for no limit.
        estimate: of the fit, whose own residual the verdict compares with; None to judge without it.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link")
        >>> fit = robot.identify(robot.simulate(duration=5.0, seed=1).log)
        >>> validation = fit.validate(robot.simulate("tc", duration=5.0, seed=2).log, gate=5.0)
        >>> validation.accepted, validation.mean_relative_percent < 4.0
        (True, True)
    """

    product: "identification.AnyValidation"
    gate: float | None = None
    estimate: "report.AnyEstimate | None" = None
    _tried = True

    def __post_init__(self) -> None:
        """Check the gate.

        Raises:
            UsageError: it is not a positive number.
        """
        check_value("gate", self.gate, ABOVE)

    @property
    def source(self) -> str:
        """Return the log."""
        return self.product.source

    @property
    def residual(self) -> "tuple[estimators.Residual, ...]":
        """Return the residual torque, joint by joint."""
        return self.product.residual

    @property
    def mean_relative_percent(self) -> float:
        """Return the mean over joints of `100 |tau - tau_predicted| / |tau|`."""
        return self.product.mean_relative_percent

    @cached_property
    def verdict(self) -> "report.FitVerdict":
        """Return how well the log is predicted: "good", "usable", "doubtful" or "wrong", and why."""
        return report.judge_trial(self.product, self.estimate)

    def _name_file(self) -> str:
        return self.source

    @property
    def errors(self) -> tuple[Notice, ...]:
        """Return the error of a wrong verdict, and the reason if the gate is missed."""
        return (*super().errors, *self.product.list_missed(self.gate))

    def summarise(self) -> str:
        """Return the log and the mean relative residual."""
        reached = f"mean relative residual {self.mean_relative_percent:.4f} %"
        return f"{self.product.robot.name} on {self.source}: {reached}"

    def blocks(self) -> "tuple[report.Block, ...]":
        """Return the headline and the tables of residuals."""
        found = self.product
        if isinstance(found, identification.ElasticValidation):
            return _show_elastic(found)
        motion, within, more = found.validation.motion, "", ""
        match found:
            case identification.RigidValidation():
                kind = " (joints taken as rigid)" if any(found.robot.elastic) else ""
                limit, table = found.validation.scoring, report.texts.show_residual(found.residual)
                metric = report.texts.show_all_rows(found.validation)
                if found.band is not None:
                    limit, motion, stacked = found.band.band, (), found.band.stacked_percent
                    metric = f"measured and predicted torque: both low-pass at {limit:g} Hz (Butterworth, "
                    metric += "order 4, zero phase), without 0.5 s at either end"
                    metric += "" if stacked is None else f"; all joints as one vector: {stacked:.4f} %"
                    rows = [
                        (e.joint, e.std, f"{e.relative_percent:.4f}", f"{share:.4f}", e.unit, e.samples)
                        for e, share in zip(found.band.joints, found.band.range_percent, strict=True)
                    ]
                    header = ("joint", "rms", "relative/%", "of range/%", "unit", "samples")
                    table = report.Table(header, rows, (0, 4))
                within = f" within {limit:.3g} Hz" if limit else ""
                more = "".join(f"\n{text}" for text in (found.settled.describe(), metric) if text)
            case identification.FrictionValidation():
                kind = ", friction and rigid part"
                laws = [
                    (e.joint, found.laws[e.joint], f"{e.relative_percent:.4f}", e.std, e.unit, e.samples)
                    for e in found.validation.residual
                ]
                table = report.Table(("joint", "law", "relative/%", "RMS", "unit", "rows"), laws, (0, 1, 4))
        mean = f"mean relative residual {found.mean_relative_percent:.4f} %"
        headline = f"{found.robot.name}{kind} on {found.validation.source}{within}: {mean}"
        return (f"{headline}{more}", table, *report.texts.show_motion(motion))

    def _describe(self) -> dict[str, object]:
        match self.product:
            case identification.RigidValidation(band=band) as found:
                within = band and {
                    "frequency": band.band,
                    "residual": [
                        {**describe_record(entry), "range_percent": share}
                        for entry, share in zip(band.joints, band.range_percent, strict=True)
                    ],
                    "stacked_percent": band.stacked_percent,
                    "mean_relative_percent": band.mean_relative_percent,
                }
                plain = {
                    **report.texts.describe_validation(found.validation),
                    "mean_relative_percent": found.mean_relative_percent,
                    "residual": [describe_record(entry) for entry in found.residual],
                    **({} if within is None else {"band": within}),
                    "processing": {**asdict(found.settled.processing), "origin": dict(found.settled.origin)},
                }
            case identification.FrictionValidation() as found:
                plain = report.texts.describe_validation(found.validation) | {"laws": dict(found.laws)}
            case identification.ElasticValidation() as found:
                plain = _describe_elastic(found)
        return {**plain, "gate": self.gate, "accepted": self.accepted}

    def _draw(self) -> "tuple[report.Drawing, ...]":
        if isinstance(self.product, identification.ElasticValidation):
            return tuple(map(report.draw_loops, self.product.trial.joints))
        found = self.product.validation
        return tuple(report.draw_prediction(series, found.rows) for series in found.series)


_UNITS = ("rad", "m")
"""Of the positions of joints that turn, and that slide."""


def _show_elastic(found: "identification.ElasticValidation") -> "tuple[report.Block, ...]":
    trial, tracking = found.trial, found.tracking
    mean = f"mean relative residual {trial.mean_relative_percent:.4f} %, by motors and links together"
    head = f"{found.robot.name} on {trial.source}: {mean}"
    if trial.means[1:]:
        head += f"; with the springs {max(trial.means[1:]):.4f} %"
    blocks: list[report.Block] = [head]
    for caption, entries in trial.residuals:
        blocks += [caption, report.texts.show_residual(entries)]
    lacking = ", ".join(joint.joint for joint in trial.joints if joint.final is None)
    if lacking:
        cannot = "its spring torque cannot be predicted, and the gate does not test it"
        blocks.append(f"The estimate has no spring of {lacking}: {cannot}.")
    if tracking is None:
        return tuple(blocks)
    rows = list[Sequence[object]]()
    for k, joint in enumerate(found.robot.axes):
        sizes = ((run.name, 1e3 * float(run.rms[k]), 1e3 * float(run.peak[k])) for run in tracking.runs)
        rows += [(joint.name, *size, f"m{_UNITS[joint.prismatic]}") for size in sizes]
    text = f"Tracking of {tracking.trajectory.source}: closed loop of the robot file's values, which the "
    text += "feed-forward does not use. The rigid feed-forward has dynamics and friction of Case 1."
    return (
        *blocks,
        text,
        report.Table(("joint", "feed-forward", "rms", "peak", "unit"), rows, left=(0, 1, 4)),
    )


def _describe_elastic(found: "identification.ElasticValidation") -> dict[str, object]:
    trial, tracking, joints = found.trial, found.tracking, found.robot.axes
    tables = [
        {"caption": caption, "residual": list(map(describe_record, entries)), "mean_relative_percent": mean}
        for (caption, entries), mean in zip(trial.residuals, trial.means, strict=True)
    ]
    return {
        "robot": found.estimate.robot,
        "method": found.estimate.method,
        "log": trial.source,
        "samples": len(trial.joints[0].time),
        "residual": tables[0]["residual"],
        "mean_relative_percent": trial.mean_relative_percent,
        "tables": tables,
        "alignment": found.alignment
        and report.texts.describe_alignment(found.alignment, [joint.name for joint in joints]),
        "tracking": tracking
        and {
            "trajectory": tracking.trajectory.source,
            "duration": tracking.trajectory.duration,
            "seed": tracking.seed,
            "runs": [
                {
                    "feed_forward": run.name,
                    "method": tracking.methods.get(run.name),
                    "joints": [
                        {"joint": joint.name, "rms": rms, "peak": peak, "unit": _UNITS[joint.prismatic]}
                        for joint, rms, peak in zip(joints, run.rms.tolist(), run.peak.tolist(), strict=True)
                    ],
                }
                for run in tracking.runs
            ],
        },
    }


@final
class FitDiagnosis(Result):
    """Diagnosis of a fit with its own logs: correlations, bootstrap, drift, structure of the residual.

    Attributes:
        robot: its name.
        product: the full result, with notices, for example that a log has changed since the fit.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link")
        >>> path = robot.simulate(duration=5.0, seed=1).save("run.npz")
        >>> found = robot.identify(path).diagnose()
        >>> found.product.rank
        12
    """

    robot: str
    product: "rigid.Diagnosis"

    def summarise(self) -> str:
        """Return the robot and the number of essential parameters."""
        return f"{self.robot}: {len(self.product.essential.kept)} essential parameters"

    def blocks(self) -> "tuple[report.Block, ...]":
        """Return the findings, and a table of residual structure."""
        diagnosis, drift = self.product, self.product.drift
        lines = [report.describe_rank(diagnosis), report.describe_essential(diagnosis)]
        if diagnosis.refit is not None:
            moves = f"moves the estimate by {diagnosis.refit:.1g} standard deviations"
            same = diagnosis.refit < _SAME_FIT
            lines.append(f"Refitting the logs {'reproduces the stored estimate' if same else moves}.")
        if len(drift.runs) > 1:
            lines.append(f"{len(drift.changed)} of {drift.compared} parameters differ between the logs.")
        for entry in diagnosis.prices:
            verb = "lowers" if entry.percent < 0.0 else "raises"
            what = f"{entry.what[:1].upper()}{entry.what[1:]}"
            lines.append(f"{what} {verb} the {entry.of} by {abs(entry.percent):.3g} %.")
        rows = [(e.joint, e.family, f"{e.share_percent:.3g}", e.rms, e.unit) for e in diagnosis.structure]
        header = ("joint", "residual follows", "share/%", "rms", "unit")
        return ("\n".join(lines), *([report.Table(header, rows, (0, 1, 4))] if rows else []))

    def _describe(self) -> dict[str, object]:
        diagnosis, found = self.product, self.product.bootstrap
        columns = (found.deviations.tolist(), found.low.tolist(), found.high.tolist())
        return {
            **describe_record(diagnosis),
            "refit": None if diagnosis.refit is None else {"largest_difference_stds": diagnosis.refit},
            "correlated": [
                {"parameters": [first, second], "correlation": value}
                for first, second, value in diagnosis.correlated
            ],
            "bootstrap": {
                "blocks": found.blocks,
                "replicates": found.replicates,
                "parameters": [
                    {"name": name, "std": std, "low": low, "high": high}
                    for name, std, low, high in zip(found.names, *columns, strict=True)
                ],
            },
            "structure": [
                {**describe_record(entry), "advice": entry.advice} for entry in diagnosis.structure
            ],
        }


_SAME_FIT = 0.05
"""Standard deviations of a parameter below which a refit is the same."""


@final
class FitPage(JudgedResult):
    """A page that was written, with validation and diagnosis.

    Attributes:
        page: the full result.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link")
        >>> fit = robot.identify(robot.simulate(duration=5.0, seed=1).log)
        >>> fit.report("report.html", validation=robot.simulate("tc", duration=5.0).log).file.name
        'report.html'
    """

    page: "report.WrittenPage"

    @property
    def file(self) -> Path:
        """Return the path of the page."""
        return self.page.file

    @property
    def diagnosis(self) -> "rigid.Diagnosis | None":
        """Return the diagnosis; None if it was not requested."""
        return self.page.diagnosis

    @property
    def verdict(self) -> "report.FitVerdict":
        """Return the verdict on the fit, with that of the held-out logs: the headline of the page."""
        return self.page.verdict

    @property
    def sources(self) -> tuple[str, ...]:
        """Return the held-out logs."""
        return self.page.sources

    def _list_remarks(self) -> tuple[Notice, ...]:
        return self.page.notices

    def summarise(self) -> str:
        """Return the path of the page."""
        return str(self.file)

    def blocks(self) -> "tuple[report.Block, ...]":
        """Return the path of the page, the processing of the logs, and the diagnosis."""
        head = "\n".join((f"report: {show_path(self.file)}", *self.page.lines))
        return (head, *(found.blocks() if (found := self._diagnosis) else ()))

    @property
    def _diagnosis(self) -> FitDiagnosis | None:
        found = self.diagnosis
        return None if found is None else FitDiagnosis(robot=self.page.robot, product=found)

    def _describe(self) -> dict[str, object]:
        page = self.page
        found: dict[str, object] = {"robot": page.robot, "file": page.file, "validations": page.sources}
        if page.processing is not None:
            found["processing"] = page.processing
        if self._diagnosis is not None:
            found["diagnosis"] = self._diagnosis.to_dict()
        return found


DeviationUnit = Literal["absolute", "percent"]

_TABLE_OPTIONS = ("--name", "--value", "--deviation", "--deviation-unit", "--read-as")


@final
class Comparison(PagedResult):
    """A comparison of a fit with one or more others, in the groupings of the others.

    Attributes:
        ours: the fit.
        found: the full result for every other.
        gate: limit of the largest difference in standard deviations; None for no limit.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link")
        >>> first, second = (robot.identify(robot.simulate(duration=5.0, seed=seed).log) for seed in (1, 2))
        >>> found = first.compare(second)
        >>> found.judged, found.largest < 6.0
        (12, True)
    """

    ours: "identification.EstimateSide"
    found: "tuple[identification.Compared, ...]"
    gate: float | None = None

    @property
    def others(self) -> tuple["Comparison", ...]:
        """Return the comparison with every other, separately."""
        return tuple(replace(self, found=(entry,)) for entry in self.found)

    @property
    def groups(self) -> "tuple[identification.ComparedValue, ...]":
        """Return the values of both sides in SI units, with their differences, group by group."""
        return tuple(value for entry in self.found for value in entry.values)

    @property
    def judged(self) -> int:
        """Return the number of groups with a standard deviation."""
        return sum(entry.comparison.judged for entry in self.found)

    @property
    def largest(self) -> float:
        """Return the largest difference, in standard deviations of both sides together."""
        return max(entry.comparison.largest for entry in self.found)

    def count_within(self, limit: float) -> int:
        """Return the number of groups that differ by at most `limit` standard deviations of both sides."""
        return sum(entry.comparison.count_within(limit) for entry in self.found)

    @property
    def chi_square(self) -> "identification.ChiSquare | None":
        """Return d' V^-1 d, d the differences and V the sum of both covariances; None where V is singular.

        Raises:
            UsageError: there are several others.
        """
        if len(self.found) > 1:
            text = f"chi-square needs one comparison, got {len(self.found)}; use each entry of `.others`"
            raise UsageError(Notice(code="usage.several-others", text=text))
        return self.found[0].comparison.chi_square

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return warnings: doubtful deviations, parameters left out, possible readings of groups."""
        # What was restored from one estimate says nothing of a comparison.
        notices = [
            note for note in self.ours.identified.robot.notices if note.code != "estimate.settings-differ"
        ]
        for found in self.found:
            notices += [
                *self.ours.notices,
                *found.other.notices,
                *report.texts.warn_compared(found),
            ]
        return tuple(dict.fromkeys(notices))

    @property
    def errors(self) -> tuple[Notice, ...]:
        """Return the reasons if the gate is missed."""
        return tuple(x for one in self.found for x in identification.check_comparison_gate(one, self.gate))

    def _build_page(self) -> "report.Page":
        return report.result_pages.build_comparison_page(self.ours, self.found, self.notices)

    def summarise(self) -> str:
        """Return the number of groups within two standard deviations."""
        others = ", ".join(entry.other.source.name for entry in self.found)
        within = f"{self.count_within(2.0)} of {self.judged} groups within 2 standard deviations"
        return f"{self.ours.identified.robot.name}: {within} of {others}"

    def blocks(self) -> "tuple[report.Block, ...]":
        """Return values of both sides, counts, chi-square and largest differences, for every other."""
        return report.texts.show_comparison(self.ours, self.found)

    def _describe(self) -> dict[str, object]:
        head = {"robot": self.ours.identified.robot.name, "estimate": show_path(self.ours.source)}
        others = [report.texts.describe_compared(found) for found in self.found]
        return {**head, "others": others, "gate": self.gate, "accepted": self.accepted}


def compare_fit(
    robot: "robots.Robot",
    estimate: "identification.GivenResult",
    others: "Sequence[identification.GivenResult]",
    *,
    name: str | None = None,
    value: str | None = None,
    deviation: str | None = None,
    deviation_unit: DeviationUnit | None = None,
    read_as: Mapping[str, str] | None = None,
    gate: float | None = None,
    progress: Progress = ignore,
) -> Comparison:
    """Compare a fit, or its file, with others; see `Fit.compare`.

    Raises:
        UsageError: no other is given, a file is given twice, or options for tables do not fit.
        EstimateError: files cannot be read (all of them are named), are of another model, or have nothing in
            common.
    """
    if not others:
        text = "expected at least one fit, file or table to compare with, got none"
        raise UsageError(Notice(code="usage.no-other", text=text))
    check_value("gate", gate, ABOVE)
    files = [Path(entry) for entry in others if isinstance(entry, str | PathLike)]
    ours_file = [Path(estimate)] if isinstance(estimate, str | PathLike) else []
    identification.check_files((*ours_file, *files), getattr(estimate, "file", None))
    tables = [path for path in files if identification.is_table(path)]
    asked = dict(zip(_TABLE_OPTIONS, (name, value, deviation, deviation_unit, read_as), strict=True))
    if not tables and any(asked.values()):
        used = ", ".join(option for option, entry in asked.items() if entry)
        given = ", ".join(map(str, files)) or "fits"
        text = f"{used}: only for tables, and none is among {given}; leave it out"
        raise UsageError(Notice(code="usage.no-table", text=text))
    progress(f"deriving the base parameters of {robot.name}")
    ours = identification.build_side(robot, *identification.read_dynamics(estimate))
    percent = None if deviation_unit is None else deviation_unit == "percent"
    columns = robots.TableColumns(name=name, value=value, deviation=deviation, percent=percent)
    readings = {"".join(group.split()): text for group, text in (read_as or {}).items()}

    def compare(entry: "identification.GivenResult") -> "identification.Compared":
        if isinstance(entry, str | PathLike) and Path(entry) in tables:
            return identification.compare_with_table(ours, Path(entry), columns, readings)
        side = identification.build_side(robot, *identification.read_dynamics(entry))
        return identification.compare_with_estimate(ours, side)

    return Comparison(ours=ours, found=tuple(map(compare, others)), gate=gate)
