"""Studies of simulated robots, in tables for people and as objects for programs.

Products of the room `study` -> blocks, dictionaries; the tables of the friction study are on its page too.

Supported: all parts of all studies. Not supported: LaTeX.
"""

import math
import textwrap
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

from symid.identification.friction import STOCHASTIC
from symid.joint_models import get_law
from symid.report.blocks import Block, Table, select_fields
from symid.study import (
    AGREEMENT,
    NEARNESS,
    NOT_IDENTIFIABLE,
    PEAK,
    RECOVERY_PEAKS,
    TABLE_1,
    TABLE_3,
    TABLE_4,
    AgreementStudy,
    EstimatorComparison,
    FrictionCheck,
    FrictionStudy,
    GainStudy,
    MeanGain,
    Recovery,
    describe_gain_miss,
)

if TYPE_CHECKING:
    from symid.study import (
        CutoffStudy,
        DatasetStudy,
        ElasticStudy,
        ManyJointsResult,
        MethodErrors,
        PrecisionStudy,
        TrackingStudy,
    )

_MARK = "*"


def list_tables(study: FrictionStudy) -> tuple[Table, ...]:
    """Return all tables, the paper's in the order of their numbers."""
    return (
        _list_methods(study.agreement[0], study.seeds[0]),
        _list_agreement(study.agreement),
        *(_list_recovery(entry) for entry in study.recovery),
        _list_sums(study.gains),
        _list_gains(study.gains),
        *(_list_contest(entry) for entry in study.contests),
        *(_list_second(entry) for entry in study.second),
    )


def _join_lines(*texts: str) -> str:
    return "\n".join(texts)


def write_check_outcome(check: FrictionCheck) -> str:
    """Return whether a claim is met, in a word or two."""
    if check.met is None:
        return "told"
    return "met" if check.met else "MISSED"


def _list_methods(study: AgreementStudy, seed: int) -> Table:
    rows = [
        (f"paper, {row.method}", *(f"{value:.5g}" for value in row.values), f"{row.objective:.0f}")
        for row in TABLE_1
    ]
    rows += [
        (f"ours, {row.estimator}", *(f"{value:.5g}" for value in row.values), f"{row.objective:.4f}")
        for row in study.rows
    ]
    rows.append(("ours, truth", *(f"{value:.5g}" for value in study.truth), f"{study.expected:.1f}"))
    rows.append(("ours, Cramer-Rao", *(f"{value:.2g}" for value in study.bound), ""))
    return Table(
        title="Table 1: joint 1, one trajectory, one direction, original Stribeck law",
        header=("method", *_name_columns(study.names), "sum of squares"),
        rows=rows,
        note=_join_lines(
            (
                f"Ours: {study.sweep.samples} samples of half a cosine, peak {study.sweep.peak:g} rad/s, "
                f"noise {study.noise:.4g} N m, seed {seed}; the truth is the paper's last row. Its "
                "recording is not public, so that rows of the paper compare with each other, and ours with "
                "theirs."
            ),
            "Behind the truth stands sigma^2 (N - 4), what the sum is on average over draws.",
        ),
    )


def _name_columns(names: Sequence[str]) -> tuple[str, ...]:
    units = {"vs": "rad/s", "dq0": "rad/s", "fV": "N m s/rad", "gamma": "1"}
    return tuple(f"{name} ({units.get(name, 'N m')})" for name in names)


def _list_agreement(studies: Sequence[AgreementStudy]) -> Table:
    return Table(
        left=(0, 1),
        title=f"Agreement of all estimators, {studies[0].draws} draws of three motions each",
        header=("peak, samples", "estimator", "worst excess", "draws within", "farthest", "beyond 3"),
        rows=tuple(
            (
                f"{study.sweep.peak:g} rad/s, {study.sweep.samples}",
                row.estimator,
                f"{row.excess:.1e}",
                f"{row.agreed} of {row.draws}",
                f"{row.error:.2f}",
                f"{row.outside} of {row.draws * len(study.truth)}",
            )
            for study in studies
            for row in study.rows
        ),
        note=(
            "Excess: sum of squares over the least one of the draw, less one. Within: "
            f"{AGREEMENT:g} for deterministic estimators, {NEARNESS:g} for "
            f"{', '.join(sorted(STOCHASTIC))}. Farthest: the largest error of a parameter in Cramer-Rao "
            "deviations."
        ),
    )


def _list_recovery(study: Recovery) -> Table:
    parameters = study.parameters
    peaks = " and ".join(f"{peak:g}" for peak in RECOVERY_PEAKS)
    return Table(
        title=f"Table 3: joint {study.joint}, two trajectories, improved Stribeck law",
        header=(f"{study.draws} draws", *_name_columns([entry.name for entry in parameters])),
        rows=(
            ("paper = truth", *(f"{entry.truth:.5g}" for entry in parameters)),
            ("ours, mean", *(f"{entry.mean:.5g}" for entry in parameters)),
            ("ours, deviation", *(f"{entry.deviation:.3g}" for entry in parameters)),
            ("Cramer-Rao", *(f"{entry.bound:.3g}" for entry in parameters)),
            ("deviation / Cramer-Rao", *(f"{entry.ratio:.3f}" for entry in parameters)),
            ("bias / deviation", *(f"{entry.bias:+.3f}" for entry in parameters)),
        ),
        note=(
            f"Cosines with peaks {peaks} rad/s, {study.samples} samples in all, {study.slow} of them "
            f"within dq0, noise {study.noise:g} N m, exponent 2. {study.solves} linear problems a fit "
            "at most."
        ),
    )


def _list_sums(studies: Sequence[GainStudy]) -> Table:
    names = ("Coulomb + viscous", "original Stribeck", "improved Stribeck")
    rows = [
        (f"joint {study.joint}, {who}", *(f"{value:.{digits}f}" for value in values))
        for study in studies
        for who, values, digits in (
            ("paper", study.paper, 0),
            ("ours, scaled", study.scaled, 0),
            ("ours, mean", study.sums, 0),
        )
    ]
    return Table(
        title="Table 4: sums of squared errors, (N m)^2",
        header=("joint", *names),
        rows=rows,
        note=(
            f"Ours: one cosine, peak {PEAK:g} rad/s, {studies[0].samples} samples, {studies[0].draws} "
            "draws; scaled: one factor a joint, so that the improved law has the paper's sum: sums grow "
            "with the number of samples, which the paper does not say."
        ),
    )


def _list_gains(studies: Sequence[GainStudy]) -> Table:
    misses = "; ".join(f"joint {study.joint}: {describe_gain_miss(study.stribeck)}" for study in studies)
    return Table(
        title="Table 4: how much less the improved law leaves, percent of the sum of squares",
        header=("joint, against", "paper", "ours", "deviation", "miss", "held out", "in RMS", "paper in RMS"),
        rows=tuple(
            _write_gain(f"{study.joint}, {name}", gain, study.paper[column], study.paper[-1])
            for column, name in enumerate(("Coulomb + viscous", "original Stribeck"))
            for study in studies
            for gain in ((study.viscous, study.stribeck)[column],)
        ),
        note=_join_lines(
            (
                f"The noise ({', '.join(f'{row.noise:g}' for row in TABLE_4)} N m) was set so that the gain "
                "over Coulomb + viscous comes out as the paper prints it: these three rows are no test."
            ),
            (
                f"The gain over the original Stribeck law is a prediction; one number, the peak of {PEAK:g} "
                "rad/s of the motion, was chosen for the least miss of the three joints together. "
                f"Misses: {misses}."
            ),
            (
                "Reading H1 adds fP at all velocities, which no law without a bias can follow: in a motion "
                "that is the same in both directions it alone gives a gain of fP^2 / (fP^2 + sigma^2), "
                f"{_list_floors()} %. Where that is more than the paper prints, it had not both H1 and this "
                "noise."
            ),
            "Held out: the same fits on another draw of the same motion.",
        ),
    )


def _list_floors() -> str:
    """Return the gain by the bias alone, joint by joint, in percent."""
    names = [entry.name for entry in get_law(TABLE_3[0].law).physical]
    biases = [row.values[names.index("fP")] for row in TABLE_3]
    shares = [bias**2 / (bias**2 + row.noise**2) for bias, row in zip(biases, TABLE_4, strict=True)]
    return ", ".join(f"{100.0 * share:.1f}" for share in shares)


def _write_gain(name: str, gain: MeanGain, other: float, improved: float) -> tuple[str, ...]:
    return (
        name,
        f"{gain.paper:.1f}",
        f"{gain.mean:.1f}",
        f"{gain.deviation:.1f}",
        f"{gain.miss:+.1f}",
        f"{gain.held_out:.1f}",
        f"{gain.rms:.1f}",
        f"{100.0 * (1.0 - math.sqrt(improved / other)):.1f}",
    )


def _list_contest(contest: EstimatorComparison) -> Table:
    timed = any(math.isfinite(run.seconds) for run in contest.runs)
    times = (f"ms{_MARK}",) if timed else ()
    names = (
        "estimator",
        "sum of squares",
        "excess",
        "evaluations",
        "linear problems",
        "iterations",
        *times,
    )
    rows = [
        (
            run.estimator,
            f"{run.objective:.6f}",
            f"{run.excess:.1e}",
            str(run.evaluations),
            str(run.solves),
            str(run.iterations),
            *(f"{1e3 * run.seconds:.0f}" for _ in times),
        )
        if not run.reason
        else (run.estimator, *("-",) * (len(names) - 1))
        for run in contest.runs
    ]
    refused = [f"{run.estimator} was not run: {run.reason}." for run in contest.runs if run.reason]
    return Table(
        title=f"All estimators on one data set: {contest.title}, {contest.law}, {contest.samples} samples",
        header=names,
        rows=rows,
        note=_join_lines(
            "Excess: over the least sum of squares of all. Every estimator with its defaults.",
            *(
                f"{_MARK} The least of three runs with the uncertainty of the result, on a machine as busy "
                "as it was; differs from run to run, as nothing else here does."
                for _ in times
            ),
            *refused,
        ),
    )


def _list_second(study: Recovery) -> Table:
    parameters = study.parameters
    return Table(
        title=f"A second truth: {study.joint}, law {study.law}",
        header=(f"{study.draws} draws", *_name_columns([entry.name for entry in parameters])),
        rows=(
            ("published = truth", *(f"{entry.truth:.5g}" for entry in parameters)),
            ("ours, mean", *(f"{entry.mean:.5g}" for entry in parameters)),
            ("ours, deviation", *(f"{entry.deviation:.3g}" for entry in parameters)),
            ("Cramer-Rao", *(f"{entry.bound:.3g}" for entry in parameters)),
            (
                "Cramer-Rao, % of value",
                *(f"{100.0 * entry.bound / abs(entry.truth):.2g}" for entry in parameters),
            ),
            ("farthest, in Cramer-Rao", *(f"{entry.error:.2f}" for entry in parameters)),
            ("draws within 3", *(str(entry.inside) for entry in parameters)),
            ("identifiable", *("yes" if entry.told else "no" for entry in parameters)),
        ),
        note=(
            f"Cosines with peaks 3 vs and 1 rad/s, {study.samples} samples in all, {study.slow} of them "
            f"slower than vs, noise {study.noise:.3g} N m = 0.02 fC; identifiable: the bound is at most "
            f"{100.0 * NOT_IDENTIFIABLE:g} % of the value."
        ),
    )


_WIDTH = 110


def show_precision(study: "PrecisionStudy") -> tuple[Block, ...]:
    """Return the errors of every method over the Cramer-Rao bound."""
    heading = ["method", "mean", "worst", "of", "95 % held, %", "price at most, %", "least eigenvalue"]
    rows = [
        [
            entry.method,
            f"{entry.mean_ratio:.3f}",
            f"{entry.worst_ratio:.3f}",
            entry.worst,
            f"{entry.coverage_percent:.1f}",
            f"{entry.worst_price_percent:.2g}",
            "-" if entry.least_eigenvalue is None else f"{entry.least_eigenvalue:.3g}",
        ]
        for entry in study.methods
    ]
    title = (
        f"{study.robot}: {len(study.names)} parameters, five random excitations of {study.samples} "
        f"samples, condition {study.condition:.3g}, {study.seeds} seeds;\n"
        "root-mean-square errors over the Cramer-Rao bound"
    )
    return (Table(heading, rows, (0, 3), title),)


def show_cutoff(study: "CutoffStudy") -> tuple[Block, ...]:
    """Return what fits with different cut-offs leave of the torque that they were not fitted to."""
    heading = ["cut-off, Hz", f"torque, 1 in {study.factor}", "torque, all", "momentum"]
    rows = [
        [f"{line.cutoff:g}", *map(_show_percent, (line.decimated, line.plain, line.momentum))]
        for line in study.lines
    ]
    title = (
        f"{study.robot}, {study.source}: fitted to the first 60 %, residual of the rest within "
        f"{study.band:g} Hz in percent;\nthe cut-off that identify takes is {study.chosen:g} Hz"
    )
    return (Table(heading, rows, title=title),)


def _show_percent(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def describe_elastic_study(study: "ElasticStudy", numbers: range) -> dict[str, object]:
    """Return the errors of every method on every set of logs as `--json` gives them."""
    return {
        "robot": study.robot,
        "seeds": list(numbers),
        "studies": [
            {
                "condition": entry.condition.value,
                **select_fields(entry, "dataset seeds bound_percent=bound spring_bound_percent=spring_bound"),
                "methods": [_describe_cell(cell) for cell in entry.cells],
            }
            for entry in study.studies
        ],
    }


def _describe_cell(cell: "MethodErrors") -> dict[str, object]:
    return {
        "method": cell.method,
        "parameter_error_percent": asdict(cell.parameter),
        "hysteresis_error_percent": asdict(cell.hysteresis),
        "excited_error_percent": asdict(cell.excited),
        "seconds": cell.seconds,
        "iterations": cell.iterations,
        "outcomes": dict(cell.outcomes),
        "choices": dict(cell.choices),
    }


def show_elastic_study(study: "ElasticStudy") -> tuple[Block, ...]:
    """Return the errors of every method, a table for each set of logs."""
    head = (
        f"{study.robot}: errors in percent, median and 90th percentile. param: the largest of all dynamic "
        "parameters; hyst: of the worse joint on the held-out motion; in range: on the same, scaled into the "
        "torsion of the logs"
    )
    return (head, *map(_show_dataset, study.studies))


def _show_dataset(entry: "DatasetStudy") -> Table:
    plural = "s" if entry.seeds > 1 else ""
    title = f"{entry.dataset}, {entry.condition.value}, {entry.seeds} run{plural}"
    if entry.bound == entry.bound:
        title += (
            f"; Cramer-Rao: {entry.bound:.3g} % standard deviation of the least certain parameter, "
            f"{entry.spring_bound:.3g} % where the form of the springs is known"
        )
    times = {cell.method: f"{cell.seconds:.2f}" for cell in entry.cells if math.isfinite(cell.seconds)}
    rows = [
        [
            cell.method,
            _show_error(cell.parameter.median),
            _show_error(cell.parameter.percentile90),
            _show_error(cell.hysteresis.median),
            _show_error(cell.hysteresis.percentile90),
            _show_error(cell.excited.median),
            *([times[cell.method]] if times else []),
            _join(cell.choices or cell.outcomes),
        ]
        for cell in entry.cells
    ]
    heading = ["method", "param", "90th", "hyst", "90th", "in range", *(["s"] if times else []), "outcome"]
    return Table(heading, rows, title=title)


def _show_error(value: float) -> str:
    return "-" if value == float("inf") else f"{value:.3g}"


def _join(counts: Sequence[tuple[str, int]]) -> str:
    return ", ".join(word if len(counts) == 1 else f"{word} {count}" for word, count in counts)


def show_tracking(study: "TrackingStudy") -> tuple[Block, ...]:
    """Return how links follow with every model, and what is certain of the differences."""
    heading = ["case", *(f"{name} rms/mrad" for name in study.joints)]
    rows = [[case, *(f"{1e3 * spread.median:.4g}" for spread in spreads)] for case, spreads in study.rms]
    compared = [
        [
            f"{entry.first} less {entry.second}",
            entry.joint,
            f"{1e3 * entry.difference.mean:.4g}",
            f"{1e3 * entry.difference.low:.4g} .. {1e3 * entry.difference.high:.4g}",
            entry.difference.verdict,
        ]
        for entry in study.comparisons
    ]
    return (
        f"{study.robot}: tracking of the held-out motion, medians over {study.seeds} seeds",
        Table(heading, rows),
        "paired differences of RMS errors in mrad",
        Table(["difference", "joint", "mean", "95 % interval", "verdict"], compared),
    )


def describe_many_joints(result: "ManyJointsResult") -> dict[str, object]:
    """Return what each method leaves of a held-out motion as `--json` gives it."""
    return {
        **select_fields(result, "robot parameters joints condition_elimination condition_energy"),
        "condition": result.condition.value,
        "methods": [asdict(entry) for entry in result.methods],
    }


def show_many_joints(result: "ManyJointsResult") -> Table:
    """Return what each method leaves of a held-out motion, next to what the true parameters leave."""
    rows = [
        [f"{entry.method}{suffix}", *(f"{value:.4f}" for value in values)]
        for entry in result.methods
        for suffix, values in (("", entry.residual), (", true parameters", entry.floor))
    ]
    title = (
        f"{result.robot}, {result.condition.value}: {result.parameters} parameters; "
        "what is left of the torque of a held-out motion, in percent"
    )
    conditions = (
        f"condition of the column-scaled rows: elimination {result.condition_elimination:.3g}, "
        f"energy {result.condition_energy:.3g}"
    )
    return Table(["method", *result.joints], rows, title=title, note=conditions)


def show_friction_tables(study: "FrictionStudy") -> tuple[Block, ...]:
    """Return the tables of joint friction, the paper's and ours, and what is asked of ours."""
    return (*list_tables(study), _show_checks(study.checks))


def _show_checks(checks: "Sequence[FrictionCheck]") -> str:
    lines = [
        textwrap.fill(
            f"{write_check_outcome(check):6}  {check.name}: {check.found} (asked: {check.bar})",
            width=_WIDTH,
            subsequent_indent=" " * 8,
        )
        for check in checks
    ]
    return "\n".join(("what is asked, and what came out", *lines))
