"""The tables of the study of friction as texts, for the page and for the terminal alike.

Input: `FrictionStudy`. Output: `StudyTable`, rows of strings with a title and sentences on how to read them.

Supported: all parts of the study. Not supported: LaTeX.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from symid.friction.estimators import STOCHASTIC
from symid.joint.friction_laws import get_law
from symid.study.friction_agreement import AGREEMENT, NEARNESS, AgreementStudy, Contest
from symid.study.friction_checks import FrictionCheck, find_gain_sentence
from symid.study.friction_gains import PEAK, GainStudy, MeanGain
from symid.study.friction_paper import RECOVERY_PEAKS, TABLE_1, TABLE_3, TABLE_4
from symid.study.friction_recovery import UNTOLD, Recovery
from symid.study.friction_study import FrictionStudy

__all__ = ["StudyTable", "list_tables", "write_verdict"]

_MARK = "*"


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyTable:
    """A table: `names` of its columns, `rows` of equal length, `notes` on how to read it."""

    title: str
    names: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...]


def list_tables(study: FrictionStudy) -> tuple[StudyTable, ...]:
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


def write_verdict(check: FrictionCheck) -> str:
    """Return whether a claim is met, in a word or two."""
    if check.met is None:
        return "told"
    return "met" if check.met else "MISSED"


def _list_methods(study: AgreementStudy, seed: int) -> StudyTable:
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
    return StudyTable(
        title="Table 1: joint 1, one trajectory, one direction, original Stribeck law",
        names=("method", *_name_columns(study.names), "sum of squares"),
        rows=tuple(rows),
        notes=(
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


def _list_agreement(studies: Sequence[AgreementStudy]) -> StudyTable:
    return StudyTable(
        title=f"Agreement of all estimators, {studies[0].draws} draws of three motions each",
        names=("peak, samples", "estimator", "worst excess", "draws within", "farthest", "beyond 3"),
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
        notes=(
            (
                "Excess: sum of squares over the least one of the draw, less one. Within: "
                f"{AGREEMENT:g} for deterministic estimators, {NEARNESS:g} for "
                f"{', '.join(sorted(STOCHASTIC))}. Farthest: the largest error of a parameter in Cramer-Rao "
                "deviations."
            ),
        ),
    )


def _list_recovery(study: Recovery) -> StudyTable:
    parameters = study.parameters
    peaks = " and ".join(f"{peak:g}" for peak in RECOVERY_PEAKS)
    return StudyTable(
        title=f"Table 3: joint {study.joint}, two trajectories, improved Stribeck law",
        names=(f"{study.draws} draws", *_name_columns([entry.name for entry in parameters])),
        rows=(
            ("paper = truth", *(f"{entry.truth:.5g}" for entry in parameters)),
            ("ours, mean", *(f"{entry.mean:.5g}" for entry in parameters)),
            ("ours, deviation", *(f"{entry.deviation:.3g}" for entry in parameters)),
            ("Cramer-Rao", *(f"{entry.bound:.3g}" for entry in parameters)),
            ("deviation / Cramer-Rao", *(f"{entry.ratio:.3f}" for entry in parameters)),
            ("bias / deviation", *(f"{entry.bias:+.3f}" for entry in parameters)),
        ),
        notes=(
            (
                f"Cosines with peaks {peaks} rad/s, {study.samples} samples in all, {study.slow} of them "
                f"within dq0, noise {study.noise:g} N m, exponent 2. {study.solves} linear problems a fit "
                "at most."
            ),
        ),
    )


def _list_sums(studies: Sequence[GainStudy]) -> StudyTable:
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
    return StudyTable(
        title="Table 4: sums of squared errors, (N m)^2",
        names=("joint", *names),
        rows=tuple(rows),
        notes=(
            (
                f"Ours: one cosine, peak {PEAK:g} rad/s, {studies[0].samples} samples, {studies[0].draws} "
                "draws; scaled: one factor a joint, so that the improved law has the paper's sum: sums grow "
                "with the number of samples, which the paper does not say."
            ),
        ),
    )


def _list_gains(studies: Sequence[GainStudy]) -> StudyTable:
    misses = "; ".join(f"joint {study.joint}: {find_gain_sentence(study.stribeck)}" for study in studies)
    return StudyTable(
        title="Table 4: how much less the improved law leaves, percent of the sum of squares",
        names=("joint, against", "paper", "ours", "deviation", "miss", "held out", "in RMS", "paper in RMS"),
        rows=tuple(
            _write_gain(f"{study.joint}, {name}", gain, study.paper[column], study.paper[-1])
            for column, name in enumerate(("Coulomb + viscous", "original Stribeck"))
            for study in studies
            for gain in ((study.viscous, study.stribeck)[column],)
        ),
        notes=(
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


def _list_contest(contest: Contest) -> StudyTable:
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
    return StudyTable(
        title=f"All estimators on one data set: {contest.title}, {contest.law}, {contest.samples} samples",
        names=names,
        rows=tuple(rows),
        notes=(
            "Excess: over the least sum of squares of all. Every estimator with its defaults.",
            *(
                f"{_MARK} The least of three runs with the uncertainty of the result, on a machine as busy "
                "as it was; differs from run to run, as nothing else here does."
                for _ in times
            ),
            *refused,
        ),
    )


def _list_second(study: Recovery) -> StudyTable:
    parameters = study.parameters
    return StudyTable(
        title=f"A second truth: {study.joint}, law {study.law}",
        names=(f"{study.draws} draws", *_name_columns([entry.name for entry in parameters])),
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
        notes=(
            (
                f"Cosines with peaks 3 vs and 1 rad/s, {study.samples} samples in all, {study.slow} of them "
                f"slower than vs, noise {study.noise:.3g} N m = 0.02 fC; identifiable: the bound is at most "
                f"{100.0 * UNTOLD:g} % of the value."
            ),
        ),
    )
