"""Studies of simulated robots as tables and as objects for JSON; the friction study has a page too."""

import math
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

from symid.identification.friction import STOCHASTIC
from symid.joint_models import get_law
from symid.report.blocks import Block, Table, select_fields, tabulate
from symid.study import (
    AGREEMENT,
    CALIBRATION,
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
    Recovery,
    SearchRace,
)

if TYPE_CHECKING:
    from symid.study import (
        CutoffStudy,
        DatasetStudy,
        ElasticStudy,
        ForeignStudy,
        ManyJointsResult,
        MethodErrors,
        PrecisionStudy,
        RecoveredParameter,
        TrackingStudy,
    )

_WIDTH = 110
_MARK = "*"
_UNITS = {"vs": "rad/s", "dq0": "rad/s", "fV": "N m s/rad", "gamma": "1"}
"""Of the parameters of friction laws; the others are torques in N m."""
_OTHER_LAWS = ("Coulomb + viscous", "original Stribeck")


def list_tables(study: FrictionStudy) -> tuple[Table, ...]:
    """Return all tables, the paper's in the order of their numbers."""
    return (
        _list_methods(study.agreement[0], study.seeds[0]),
        _list_agreement(study.agreement),
        _list_races(study.races),
        *map(_list_recovery, study.recovery),
        _list_sums(study.gains),
        _list_gains(study.gains),
        *map(_list_contest, study.contests),
        *map(_list_second, study.second),
    )


def write_check_outcome(check: FrictionCheck) -> str:
    """Return whether a claim is met, in a word."""
    return "reported" if check.met is None else "met" if check.met else "MISSED"


def _name_columns(names: Sequence[str]) -> tuple[str, ...]:
    return tuple(f"{name} ({_UNITS.get(name, 'N m')})" for name in names)


def _list_methods(study: AgreementStudy, seed: int) -> Table:
    lines = (
        *((f"paper, {row.method}", row.values, ".5g", f"{row.objective:.0f}") for row in TABLE_1),
        *((f"ours, {row.estimator}", row.values, ".5g", f"{row.objective:.4f}") for row in study.rows),
        ("ours, truth", study.truth, ".5g", f"{study.expected:.1f}"),
        ("ours, Cramer-Rao", study.bound, ".2g", ""),
    )
    rows = [(name, *(format(value, form) for value in values), last) for name, values, form, last in lines]
    note = (
        f"Ours: {study.sweep.samples} samples of half a cosine, peak {study.sweep.peak:g} rad/s, noise "
        f"{study.noise:.4g} N m, seed {seed}; the truth is the paper's last row. The paper's recording is "
        "not public: compare its rows with each other, and ours with ours.\n"
        "The sum of the truth is sigma^2 (N - 4), its mean over draws."
    )
    title = "Table 1: joint 1, one trajectory, one direction, original Stribeck law"
    return Table(("method", *_name_columns(study.names), "sum of squares"), rows, title=title, note=note)


def _list_agreement(studies: Sequence[AgreementStudy]) -> Table:
    rows = [
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
    ]
    header = ("peak, samples", "estimator", "worst excess", "draws within", "farthest", "beyond 3")
    title = f"Agreement of all estimators, {studies[0].draws} draws of three motions each"
    note = (
        f"Excess: sum of squares over the least one of the draw, less one. Within: {AGREEMENT:g} for "
        f"deterministic estimators, {NEARNESS:g} for {', '.join(sorted(STOCHASTIC))}. Farthest: the largest "
        "error of a parameter in Cramer-Rao deviations."
    )
    return Table(header, rows, (0, 1), title, note)


def _list_races(races: Sequence[SearchRace]) -> Table:
    rows = [
        (
            race.title,
            cost.estimator,
            str(cost.population),
            f"{cost.generations:.1f}",
            f"{cost.evaluations:.0f}",
            f"{cost.near_generations:.1f}",
            f"{cost.near_evaluations:.0f}",
        )
        for race in races
        for cost in race.costs
    ]
    title = f"Table 2: genetic algorithm and its hybrid with annealing, means of {races[0].draws} draws"
    header = (
        "motion",
        "search",
        "candidates",
        "generations",
        "evaluations",
        "near: gen.",
        "near: eval.",
    )
    findings = "\n".join(f"{race.title}: {race.finding}." for race in races)
    note = (
        "The paper: a generation of the hybrid takes longer, but far fewer are needed, so that it is more "
        f"efficient. Ours, hybrid against genetic:\n{findings}\n"
        "Both end where the candidates' objectives differ by 1e-6; near: the best is within "
        f"{100.0 * NEARNESS:g} % of the least sum of squares. A generation of the hybrid evaluates every "
        "candidate twice. The paper prints neither its algorithms nor its numbers of generations: both "
        "algorithms are our own designs, with their defaults."
    )
    return Table(header, rows, (0, 1), title, note)


def _transpose(
    study: Recovery, lines: "dict[str, Callable[[RecoveredParameter], str]]", title: str, note: str
) -> Table:
    """Return a table with a column for each parameter and a row for each of `lines`."""
    columns = _name_columns([entry.name for entry in study.parameters])
    rows = [(name, *map(write, study.parameters)) for name, write in lines.items()]
    return Table((f"{study.draws} draws", *columns), rows, title=title, note=note)


def _list_recovery(study: Recovery) -> Table:
    lines: dict[str, Callable[[RecoveredParameter], str]] = {
        "paper = truth": lambda entry: f"{entry.truth:.5g}",
        "ours, mean": lambda entry: f"{entry.mean:.5g}",
        "ours, deviation": lambda entry: f"{entry.deviation:.3g}",
        "Cramer-Rao": lambda entry: f"{entry.bound:.3g}",
        "deviation / Cramer-Rao": lambda entry: f"{entry.ratio:.3f}",
        "bias / deviation": lambda entry: f"{entry.bias:+.3f}",
    }
    note = (
        f"Cosines with peaks {' and '.join(f'{peak:g}' for peak in RECOVERY_PEAKS)} rad/s, {study.samples} "
        f"samples in all, {study.slow} of them within dq0, noise {study.noise:g} N m, exponent 2. At most "
        f"{study.solves} linear problems a fit."
    )
    title = f"Table 3: joint {study.joint}, two trajectories, improved Stribeck law"
    return _transpose(study, lines, title, note)


def _list_second(study: Recovery) -> Table:
    lines: dict[str, Callable[[RecoveredParameter], str]] = {
        "published = truth": lambda entry: f"{entry.truth:.5g}",
        "ours, mean": lambda entry: f"{entry.mean:.5g}",
        "ours, deviation": lambda entry: f"{entry.deviation:.3g}",
        "Cramer-Rao": lambda entry: f"{entry.bound:.3g}",
        "Cramer-Rao, % of value": lambda entry: f"{100.0 * entry.bound / abs(entry.truth):.2g}",
        "farthest, in Cramer-Rao": lambda entry: f"{entry.error:.2f}",
        "draws within 3": lambda entry: str(entry.inside),
        "identifiable": lambda entry: "yes" if entry.told else "no",
    }
    note = (
        f"Cosines with peaks 3 vs and 1 rad/s, {study.samples} samples in all, {study.slow} of them slower "
        f"than vs, noise {study.noise:.3g} N m = 0.02 fC; identifiable: the bound is at most "
        f"{100.0 * NOT_IDENTIFIABLE:g} % of the value."
    )
    return _transpose(study, lines, f"A second truth: {study.joint}, law {study.law}", note)


def _list_sums(studies: Sequence[GainStudy]) -> Table:
    rows = [
        (f"joint {study.joint}, {who}", *(f"{value:.0f}" for value in values))
        for study in studies
        for who, values in (
            ("paper", study.paper),
            ("ours, scaled", study.scaled),
            ("ours, mean", study.sums),
        )
    ]
    note = (
        f"Ours: one cosine, peak {PEAK:g} rad/s, {studies[0].samples} samples, {studies[0].draws} draws; "
        "scaled: one factor a joint, so that the improved law has the paper's sum (the paper does not state "
        f"the number of samples).\n{CALIBRATION}"
    )
    title = "Table 4: sums of squared errors, (N m)^2"
    header = ("joint", "Coulomb + viscous, calibrated", "original Stribeck, prediction", "improved Stribeck")
    return Table(header, rows, title=title, note=note)


def _list_gains(studies: Sequence[GainStudy]) -> Table:
    rows = []
    for column, name in enumerate(_OTHER_LAWS):
        for study in studies:
            gain = (study.viscous, study.stribeck)[column]
            paper = 100.0 * (1.0 - math.sqrt(study.paper[-1] / study.paper[column]))
            values = (gain.paper, gain.mean, gain.deviation, gain.miss, gain.held_out, gain.rms, paper)
            forms = (".1f", ".1f", ".1f", "+.1f", ".1f", ".1f", ".1f")
            rows.append((f"{study.joint}, {name}", gain.role, *map(format, values, forms)))
    misses = "; ".join(f"joint {study.joint}: {study.stribeck.describe_miss()}" for study in studies)
    # The gain by the bias alone, joint by joint.
    place = [entry.name for entry in get_law(TABLE_3[0].law).physical].index("fP")
    pairs = [(row.values[place] ** 2, other.noise**2) for row, other in zip(TABLE_3, TABLE_4, strict=True)]
    floors = ", ".join(f"{100.0 * bias / (bias + noise):.1f}" for bias, noise in pairs)
    note = (
        f"{CALIBRATION} The noise is {', '.join(f'{row.noise:g}' for row in TABLE_4)} N m.\n"
        f"The predictions miss by: {misses}.\n"
        "Reading H1 adds fP at all velocities, which no law without a bias can follow: in a motion that is "
        "the same in both directions it alone gives a gain of fP^2 / (fP^2 + sigma^2), "
        f"{floors} %. Where that is more than the paper prints, it had not both H1 and this noise.\n"
        "Held out: the same fits on another draw of the same motion."
    )
    title = "Table 4: how much less the improved law leaves, percent of the sum of squares"
    header = (
        "joint, against",
        "ours is",
        "paper",
        "ours",
        "deviation",
        "miss",
        "held out",
        "in RMS",
        "paper in RMS",
    )
    return Table(header, rows, (0, 1), title, note)


def _list_contest(contest: EstimatorComparison) -> Table:
    columns = "estimator; sum of squares=objective:.6f; excess=excess:.1e; evaluations; "
    columns += "linear problems=solves; iterations"
    note = ["Excess: over the least sum of squares of all. Every estimator with its defaults."]
    if any(math.isfinite(run.seconds) for run in contest.runs):
        columns += f"; ms{_MARK}=time"
        note.append(
            f"{_MARK} The least of three runs with the uncertainty of the result; differs from run to run."
        )
    note += [f"{run.estimator} was not run: {run.reason}." for run in contest.runs if run.reason]
    return tabulate(
        [run for run in contest.runs if not run.reason],
        columns,
        title=f"All estimators on one data set: {contest.title}, {contest.law}, {contest.samples} samples",
        note="\n".join(note),
        time=lambda run: f"{1e3 * run.seconds:.0f}",
    )


def show_friction_tables(study: FrictionStudy) -> tuple[Block, ...]:
    """Return the tables of joint friction, the paper's and ours, and the claims on ours."""
    checks = [
        textwrap.fill(
            f"{write_check_outcome(check):8}  {check.name}: {check.found} (required: {check.bar})",
            width=_WIDTH,
            subsequent_indent=" " * 10,
        )
        for check in study.checks
    ]
    return (*list_tables(study), "\n".join(("claims and results", *checks)))


def show_precision(study: "PrecisionStudy") -> tuple[Block, ...]:
    """Return the errors of every method over the Cramer-Rao bound."""
    columns = (
        "method; mean=mean_ratio:.3f; worst=worst_ratio:.3f; of=worst; 95 % held, %=coverage_percent:.1f; "
        "price at most, %=worst_price_percent:.2g; least eigenvalue=least_eigenvalue:.3g"
    )
    title = (
        f"{study.robot}: {len(study.names)} parameters, five random excitations of {study.samples} "
        f"samples, condition {study.condition:.3g}, {study.seeds} seeds;\n"
        "root-mean-square errors over the Cramer-Rao bound"
    )
    return (tabulate(study.methods, columns, (0, 3), title),)


def show_cutoff(study: "CutoffStudy") -> tuple[Block, ...]:
    """Return the residuals, on the rest of the log, of fits with different cut-offs."""
    columns = (
        f"cut-off, Hz=cutoff:g; torque, 1 in {study.factor}=decimated:.2f; torque, all=plain:.2f; "
        "momentum=momentum:.2f"
    )
    title = (
        f"{study.robot}, {study.source}: fitted to the first 60 %, residual of the rest within "
        f"{study.band:g} Hz in percent;\nthe cut-off that identify takes is {study.chosen:g} Hz"
    )
    return (tabulate(study.lines, columns, title=title),)


def describe_elastic_study(study: "ElasticStudy", numbers: range) -> dict[str, object]:
    """Return the errors of every method on every set of logs as `--json` gives them."""
    return {
        "robot": study.robot,
        "seeds": list(numbers),
        "studies": [
            {
                "condition": entry.condition.value,
                **select_fields(entry, "dataset seeds bound_percent=bound spring_bound_percent=spring_bound"),
                "methods": [
                    {
                        "method": cell.method,
                        "parameter_error_percent": asdict(cell.parameter),
                        "hysteresis_error_percent": asdict(cell.hysteresis),
                        "excited_error_percent": asdict(cell.excited),
                        **select_fields(cell, "seconds iterations"),
                        "outcomes": dict(cell.outcomes),
                        "choices": dict(cell.choices),
                    }
                    for cell in entry.cells
                ],
            }
            for entry in study.studies
        ],
    }


def show_elastic_study(study: "ElasticStudy") -> tuple[Block, ...]:
    """Return the errors of every method, a table for each set of logs."""
    head = (
        f"{study.robot}: errors in percent, median and 90th percentile. param: largest of all dynamic "
        "parameters; hyst: worse joint on the held-out motion; in range: the same, scaled into the torsion "
        "of the logs"
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

    def join(cell: "MethodErrors") -> str:
        counts = cell.choices or cell.outcomes
        return ", ".join(word if len(counts) == 1 else f"{word} {count}" for word, count in counts)

    timed = any(math.isfinite(cell.seconds) for cell in entry.cells)
    rows = [
        [
            cell.method,
            *(
                "-" if value == math.inf else f"{value:.3g}"
                for spread in (cell.parameter, cell.hysteresis)
                for value in (spread.median, spread.percentile90)
            ),
            "-" if cell.excited.median == math.inf else f"{cell.excited.median:.3g}",
            *([f"{cell.seconds:.2f}"] if timed else []),
            join(cell),
        ]
        for cell in entry.cells
    ]
    heading = ["method", "param", "90th", "hyst", "90th", "in range", *(["s"] if timed else []), "outcome"]
    return Table(heading, rows, title=title)


def describe_foreign(study: "ForeignStudy", numbers: range) -> dict[str, object]:
    """Return the errors of every method on every truth as `--json` gives them."""
    return {
        "arm": study.arm,
        "seeds": list(numbers),
        "truths": [
            {
                **select_fields(entry, "truth size best near near_best"),
                "ratio": asdict(entry.ratio),
                "methods": [
                    {
                        "method": cell.method,
                        "parameter_error_percent": asdict(cell.worst),
                        "spring_error_percent": asdict(cell.spring),
                        **select_fields(cell, "z_rms z_most"),
                        "verdicts": dict(cell.verdicts),
                        "choices": dict(cell.choices),
                    }
                    for cell in entry.cells
                ],
            }
            for entry in study.truths
        ],
    }


def show_foreign(study: "ForeignStudy") -> tuple[Block, ...]:
    """Return the automatic choice on every truth, then the errors of all methods."""

    def write(value: float) -> str:
        return f"{value:.3g}" if math.isfinite(value) else "-"

    def join(counts: Sequence[tuple[str, int]]) -> str:
        return ", ".join(word if len(counts) == 1 else f"{word} {count}" for word, count in counts)

    sized = any(entry.size != 1.0 for entry in study.truths)
    names = [f"{entry.truth} x {entry.size:g}" if sized else entry.truth for entry in study.truths]
    chosen = [
        [
            name,
            write(entry.cells[0].worst.median),
            f"{write(entry.cells[0].z_rms)} ({write(entry.cells[0].z_most)})",
            write(entry.cells[0].spring.median),
            join(entry.cells[0].verdicts),
            join(entry.cells[0].choices),
            entry.best,
            write(entry.ratio.median),
            f"{entry.near} of {entry.seeds}",
            f"{entry.near_best} of {entry.seeds}",
        ]
        for name, entry in zip(names, study.truths, strict=True)
    ]
    header = ["truth", "worst", "z rms (max)", "spring", "verdict", "chosen", "best", "ratio", "near"]
    header.append("near best")
    tables = [
        Table(
            ["truth", *(cell.method for cell in study.truths[0].cells)],
            [
                [name, *(write(getattr(cell, field).median) for cell in entry.cells)]
                for name, entry in zip(names, study.truths, strict=True)
            ],
            title=title,
        )
        for field, title in (("worst", "worst parameter, percent"), ("spring", "spring torque, percent"))
    ]
    note = (
        "worst: parameter error in percent of the largest of its kind; z: errors over stated deviations; "
        "spring: its torque on the held-out motion in percent; best: method of the least median error; "
        "ratio: error of the choice over the least one of all methods in the same run; near: runs where that "
        "is at most 1.2; near best: runs where the choice is at most 1.2 times as far off as the best method"
    )
    title = f"{study.arm}: automatic choice on hidden models, medians over {study.truths[0].seeds} seeds"
    return (Table(header, chosen, left=(0, 4, 5, 6), title=title, note=note), *tables)


def show_tracking(study: "TrackingStudy") -> tuple[Block, ...]:
    """Return the tracking errors with every model, and which differences are significant."""
    heading = ["case", *(f"{name} rms/mrad" for name in study.joints)]
    rows = [[case, *(f"{1e3 * spread.median:.4g}" for spread in spreads)] for case, spreads in study.rms]
    differences = tabulate(
        study.comparisons,
        "difference=cases; joint; mean; 95 % interval=interval; verdict=difference.verdict",
        cases=lambda entry: f"{entry.first} less {entry.second}",
        mean=lambda entry: f"{1e3 * entry.difference.mean:.4g}",
        interval=lambda entry: f"{1e3 * entry.difference.low:.4g} .. {1e3 * entry.difference.high:.4g}",
    )
    return (
        f"{study.robot}: tracking of the held-out motion, medians over {study.seeds} seeds",
        Table(heading, rows),
        "paired differences of RMS errors in mrad",
        differences,
    )


def describe_many_joints(result: "ManyJointsResult") -> dict[str, object]:
    """Return what each method leaves of a held-out motion as `--json` gives it."""
    return {
        **select_fields(result, "robot parameters joints condition_elimination condition_energy"),
        "condition": result.condition.value,
        "methods": [asdict(entry) for entry in result.methods],
    }


def show_many_joints(result: "ManyJointsResult") -> Table:
    """Return the residuals of each method on a held-out motion, next to those of the true parameters."""
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
