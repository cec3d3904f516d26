"""Tests of a fit as text, objects for JSON and figures: held-out logs, diagnosis, comparison with others."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

from symid.environment import show_path
from symid.errors import Notice
from symid.identification import AnyValidation, ElasticValidation, FrictionValidation, RigidValidation
from symid.report import fit_text
from symid.report.blocks import Block, Drawing, Table
from symid.report.elastic_page import draw_loops
from symid.report.identification_page import describe_essential, describe_rank, draw_prediction
from symid.serialization import describe_record

if TYPE_CHECKING:
    from symid.dynamics import OpenReading
    from symid.identification import Compared, EstimateSide, TriedReading
    from symid.identification.rigid import Diagnosis

_UNITS = ("rad", "m")
"""Of the positions of joints that turn, and that slide."""
_SAME_FIT = 0.05
"""Standard deviations of a parameter below which a refit is the same."""
_WIDTH = 44
"""Letters of a group on one line of a table."""
_TINY = 1e-12
_TOO_SURE = 0.999
_LIMITS = ((2.0, 0.9545), (3.0, 0.9973))
"""Numbers of deviations, and the share of normal errors within them."""


def show_trial(found: AnyValidation) -> tuple[Block, ...]:
    """Return a headline, and tables of residuals."""
    if isinstance(found, ElasticValidation):
        return _show_elastic_trial(found)
    motion, within, more = found.validation.motion, "", ""
    match found:
        case RigidValidation():
            kind = " (joints taken as rigid)" if any(found.robot.elastic) else ""
            limit, table = found.validation.scoring, fit_text.show_residual(found.residual)
            metric = fit_text.show_all_rows(found.validation)
            if found.band is not None:
                limit, motion, stacked = found.band.band, (), found.band.stacked_percent
                metric = (
                    f"measured and predicted torque: both low-pass at {limit:g} Hz (Butterworth, order 4, "
                    "zero phase), without 0.5 s at either end"
                )
                metric += "" if stacked is None else f"; all joints as one vector: {stacked:.4f} %"
                of_band = [
                    (e.joint, e.std, f"{e.relative_percent:.4f}", f"{share:.4f}", e.unit, e.samples)
                    for e, share in zip(found.band.joints, found.band.range_percent, strict=True)
                ]
                header = ("joint", "rms", "relative/%", "of range/%", "unit", "samples")
                table = Table(header, of_band, (0, 4))
            within = f" within {limit:.3g} Hz" if limit else ""
            more = "".join(f"\n{text}" for text in (found.settled.describe(), metric) if text)
        case FrictionValidation():
            kind = ", friction and rigid part"
            rows = [
                (e.joint, found.laws[e.joint], f"{e.relative_percent:.4f}", e.std, e.unit, e.samples)
                for e in found.validation.residual
            ]
            table = Table(("joint", "law", "relative/%", "RMS", "unit", "rows"), rows, (0, 1, 4))
    mean = f"mean relative residual {found.mean_relative_percent:.4f} %"
    headline = f"{found.robot.name}{kind} on {found.validation.source}{within}: {mean}"
    return (f"{headline}{more}", table, *fit_text.show_motion(motion))


def describe_trial(found: AnyValidation) -> dict[str, object]:
    """Return the trial as `symid validate --json` gives it, but for the gate."""
    match found:
        case RigidValidation(band=band):
            within = band and {
                "frequency": band.band,
                "residual": [
                    {**describe_record(entry), "range_percent": share}
                    for entry, share in zip(band.joints, band.range_percent, strict=True)
                ],
                "stacked_percent": band.stacked_percent,
                "mean_relative_percent": band.mean_relative_percent,
            }
            return {
                **fit_text.describe_validation(found.validation),
                "mean_relative_percent": found.mean_relative_percent,
                "residual": [describe_record(entry) for entry in found.residual],
                **({} if within is None else {"band": within}),
                "processing": {**asdict(found.settled.processing), "origin": dict(found.settled.origin)},
            }
        case FrictionValidation():
            return {**fit_text.describe_validation(found.validation), "laws": dict(found.laws)}
        case ElasticValidation():
            return _describe_elastic(found)


def draw_trial(found: AnyValidation) -> tuple[Drawing, ...]:
    """Return measured and predicted torques against time; of elastic joints torque over torsion."""
    if isinstance(found, ElasticValidation):
        return tuple(map(draw_loops, found.trial.joints))
    return tuple(draw_prediction(series, found.validation.rows) for series in found.validation.series)


def _show_elastic_trial(found: ElasticValidation) -> tuple[Block, ...]:
    trial, tracking = found.trial, found.tracking
    mean = f"mean relative residual {trial.mean_relative_percent:.4f} %, by motors and links together"
    head = f"{found.robot.name} on {trial.source}: {mean}"
    if trial.means[1:]:
        head += f"; with the springs {max(trial.means[1:]):.4f} %"
    blocks: list[Block] = [head]
    for caption, entries in trial.residuals:
        blocks += [caption, fit_text.show_residual(entries)]
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
    text = (
        f"Tracking of {tracking.trajectory.source}: closed loop of the robot file's values, which the "
        "feed-forward does not use. The rigid feed-forward has dynamics and friction of Case 1."
    )
    return (*blocks, text, Table(("joint", "feed-forward", "rms", "peak", "unit"), rows, left=(0, 1, 4)))


def _describe_elastic(found: ElasticValidation) -> dict[str, object]:
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
        and fit_text.describe_alignment(found.alignment, [joint.name for joint in joints]),
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


def describe_diagnosis(diagnosis: "Diagnosis") -> dict[str, object]:
    """Return the diagnosis as `symid report --diagnose --json` gives it."""
    found = diagnosis.bootstrap
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
        "structure": [{**describe_record(entry), "advice": entry.advice} for entry in diagnosis.structure],
    }


def show_diagnosis(diagnosis: "Diagnosis") -> tuple[Block, ...]:
    """Return the diagnosis in a few sentences and a table of what the residual is a function of."""
    drift = diagnosis.drift
    lines = [describe_rank(diagnosis), describe_essential(diagnosis)]
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
    return ("\n".join(lines), *([Table(header, rows, (0, 1, 4))] if rows else []))


def show_comparison(ours: "EstimateSide", others: Sequence["Compared"]) -> tuple[Block, ...]:
    """Return for each other the table, counts, chi-square, the largest differences; others stand apart."""
    first, *rest = (_show_compared(ours, found) for found in others)
    return (*first, *(part for head, *parts in rest for part in (f"\n{head}", *parts)))


def _show_compared(ours: "EstimateSide", found: "Compared") -> tuple[Block, ...]:
    other, comparison = found.other, found.comparison
    columns = "" if other.columns is None else f", column {other.columns.value!r}"
    read = any(entry.read_as for entry in found.groups)
    rows = list[Sequence[object]]()
    for value in found.values:
        away = (_format_deviations(value.deviations, "+", 2), *([value.read_as] if read else []))
        rows.append((value.group, value.theirs, value.theirs_std, value.ours, value.ours_std, *away))
    header = ["group", "other", "std", "ours", "std", "in std", *(["read as"] if read else [])]
    lines = ["largest differences"]
    for place in comparison.list_farthest():
        distance = float(comparison.deviations[place])
        mine, theirs = float(comparison.ours.values[place]), float(comparison.theirs.values[place])
        share = f" ({100.0 * (mine - theirs) / abs(theirs):+.3g} %)" if theirs else ""
        lines.append(
            f"  {found.groups[place].text}: ours {mine:.4g} is {_format_deviations(abs(distance))} standard "
            f"deviations {'above' if distance > 0 else 'below'} the other's {theirs:.4g}{share}"
        )
    with_these = " with these" if found.absent or found.neither else ""
    span = f"the groups of the other{with_these} span all base parameters, exactly"
    if found.lacking > 0:
        span = f"besides, the other does not determine {found.lacking} combinations of ours"
    left_out = (
        ("ours, not in the other: ", found.absent),
        ("in neither: ", found.neither),
        ("", (span,)),
        ("the other's, refused in ours: ", found.not_ours),
        ("the other's, of another model: ", found.other.strange),
    )
    return (
        f"{ours.identified.robot.name}: {show_path(ours.source)} beside {show_path(other.source)}{columns}",
        Table(header, rows, left=(0, 6) if read else (0,), fold=_WIDTH),
        _summarise_agreement(found),
        *(["\n".join(lines)] if len(lines) > 1 else []),
        "\n".join(f"{head}{', '.join(names)}" for head, names in left_out if names),
    )


def _format_deviations(value: float, sign: str = "", digits: int = 1) -> str:
    """Return a number of deviations; beyond a hundred thousand its size is enough."""
    if math.isnan(value):
        return "-"
    return format(value, f"{sign}.{digits}f" if abs(value) < 1e5 else f"{sign}.2e")


def _summarise_agreement(found: "Compared") -> str:
    comparison = found.comparison
    judged, total = comparison.judged, comparison.chi_square
    if not judged:
        return "neither side states standard deviations: agreement cannot be judged"
    counts = ", ".join(
        f"{comparison.count_within(limit)} of {judged} within {limit:g} standard deviations "
        f"({share * judged:.0f} expected)"
        for limit, share in _LIMITS
    )
    if total is None:
        return f"{counts}\nno chi-square: the covariance of the differences is singular"
    text = f"chi-square {_format_deviations(total.value)} over {total.freedom} groups"
    if found.other.shared:
        text += "; no probability, because the estimates have logs in common"
    else:
        chance = f"{total.chance:.2g}" if total.chance > _TINY else f"below {_TINY:g}"
        text += f", probability {chance}"
        if total.chance > _TOO_SURE:
            text += "; too small for independent errors: both may come from the same log"
    if total.stretch > 1.0:
        text += f"; it would be as expected with standard deviations {total.stretch:.2g} times as large"
    return f"{counts}\n{text}"


def describe_comparison(ours: "EstimateSide", others: Sequence["Compared"]) -> dict[str, object]:
    """Return the comparison as `symid compare --json` gives it, but for the gate."""
    head = {"robot": ours.identified.robot.name, "estimate": show_path(ours.source)}
    return {**head, "others": [_describe_compared(found) for found in others]}


def _describe_compared(found: "Compared") -> dict[str, object]:
    comparison, other = found.comparison, found.other
    total = comparison.chi_square
    chance = None if total is None or other.shared else total.chance
    return {
        "source": show_path(other.source),
        "columns": other.columns and describe_record(other.columns),
        "groups": [
            {**describe_record(value), "line": value.line or None, "read_as": value.read_as or None}
            for value in found.values
        ],
        "judged": comparison.judged,
        "within": {f"{limit:g}": comparison.count_within(limit) for limit, _ in _LIMITS},
        "largest": comparison.largest,
        "chi_square": total and {"value": total.value, "freedom": total.freedom, "probability": chance},
        **{name: getattr(found, name) for name in ("absent", "neither", "lacking", "not_ours")},
        "other_model": other.strange,
        "shared_logs": other.shared,
        "readings": [
            {
                "group": found.groups[reading.group].text,
                "read_as": _write_reading(found, reading)[1],
                "coupling": reading.coupling or None,
                **describe_record(tried),
            }
            for reading, tried in found.readings
        ],
    }


def _write_reading(found: "Compared", reading: "OpenReading") -> tuple[str, str]:
    """Return the term that a group may contain, and how the group is read with it."""
    group, factor = found.groups[reading.group], str(reading.factor)
    term = {"1": reading.name, "-1": f"-{reading.name}"}.get(factor, f"{factor}*{reading.name}")
    sign = "-" if term.startswith("-") else "+"
    return term, f"{group.read_as or group.text} {sign} {term.removeprefix('-')}"


def warn_comparison(ours: "EstimateSide", others: Sequence["Compared"]) -> tuple[Notice, ...]:
    """Return the warnings of both sides, shared logs, terms that groups seem to contain."""
    # What was restored from one estimate says nothing of a comparison.
    notices = [note for note in ours.identified.robot.notices if note.code != "estimate.settings-differ"]
    for found in others:
        notices += [*ours.notices, *found.other.notices, *_warn_compared(found)]
    return tuple(dict.fromkeys(notices))


def _warn_compared(found: "Compared") -> Iterator[Notice]:
    file = str(found.other.source)

    def describe(reading: "OpenReading", tried: "TriedReading") -> str:
        return (
            f"{found.groups[reading.group].text} is {_format_deviations(abs(tried.before))} standard "
            f"deviations away as it stands, and {_format_deviations(abs(tried.after))} if it contains "
            f"{_write_reading(found, reading)[0]} too"
        )

    def write_option(reading: "OpenReading") -> str:
        return f'--read-as "{found.groups[reading.group].text} = {_write_reading(found, reading)[1]}"'

    if found.other.shared:
        text = (
            f"both estimates were fitted to {', '.join(found.other.shared)}: their errors are not "
            "independent, and differences should be smaller than the standard deviations"
        )
        yield Notice(code="compare.shared-logs", text=text, file=file)
    for coupling in dict.fromkeys(reading.coupling for reading, _ in found.readings if reading.coupling):
        entries = [entry for entry in found.readings if entry[0].coupling == coupling]
        sure = [entry for entry in entries if entry[1].decisive]
        if not sure:
            continue
        text = (
            f"{'; '.join(describe(*entry) for entry in sure)}. The other seems to count what "
            f"drive {coupling!r} adds to a single joint to that joint (an inference); to compare so: "
            f"{' '.join(write_option(reading) for reading, _ in sure)}"
        )
        undecided = "; ".join(
            f"{write_option(reading)} changes chi-square by {-tried.gain:+.1f}"
            for reading, tried in entries
            if not tried.decisive
        )
        if undecided:
            text += f". The same rule has more terms, on which the values do not decide: {undecided}"
        yield Notice(code="compare.coupled-reading", text=text, file=file)
    for reading, tried in (entry for entry in found.readings if not entry[0].coupling):
        chance = "Only the numbers support this, it may be chance"
        text = f"{describe(reading, tried)}. {chance}; to compare so: {write_option(reading)}"
        yield Notice(code="compare.other-reading", text=text, file=file)
