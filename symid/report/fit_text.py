"""Results of an identification as text, and as objects for JSON."""

import math
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from symid import joint_models
from symid.report.blocks import Block, Table, describe_outcome
from symid.serialization import describe_record, write_plain

if TYPE_CHECKING:
    from symid.arrays import FloatArray
    from symid.identification import estimators
    from symid.identification.elastic import DriveEffect, ElasticEstimate, StiffnessEstimate
    from symid.identification.friction import FrictionIdentification, PoseTest
    from symid.logs import Alignment

_EFFECTS = {
    "torque-lag": ("torque acts late", "s"),
    "link-friction": ("viscous friction of the link", "{torque} s/{position}"),
    "torque-ripple": ("torque ripple", "{torque}"),
    "kinematic-error": ("kinematic error of the gear", "{position}"),
    "link-eccentricity": ("eccentricity of the link's encoder", "{position}"),
    "torsion-offset": ("zero of the torsion", "{position}"),
}
"""What they are called, and their units."""
_STATED = {"robot file": "truth"}
_WIDTH = 100
_SHOWN = 3


def _describe_parameter(entry: "estimators.ParameterEstimate") -> dict[str, Any]:
    return {**describe_record(entry), "relative_std_percent": entry.relative_std_percent}


def describe_estimate(estimate: "estimators.Estimate") -> dict[str, object]:
    """Return the estimate as `symid identify --json` gives it."""
    found = describe_record(estimate)
    found["parameters"] = [_describe_parameter(entry) for entry in estimate.parameters]
    for entry in found["parameters"]:
        del entry["reason"]
    for entry, law in zip(found["laws"], estimate.laws, strict=True):
        entry["shape"] = dict(zip(law.names, law.shape, strict=True))
    return {
        **found,
        "mean_relative_percent": estimate.mean_relative_percent,
        "outcome": describe_outcome(estimate.outcome),
        "refused": _describe_refused(estimate.refused),
        "choice": write_plain(estimate.choice),
        "evidence": write_plain(estimate.evidence),
    }


def tabulate_laws(laws: "Sequence[estimators.FittedLaw]") -> tuple[Block, ...]:
    """Return what was found of the friction laws of all joints; nothing where none were searched."""
    if not laws:
        return ()
    rows = []
    for entry in laws:
        trials = () if entry.selection is None else entry.selection.trials
        held = {trial.law: write_number(trial.held_percent, ".3g") for trial in reversed(trials)}
        others = (f"{one.law} {held[one.law]}" for one in trials if one.law != entry.law and not one.reason)
        own, plain = held.get(entry.law, ""), held.get("coulomb-viscous-offset", "")
        rows.append((entry.joint, entry.law, own, plain, next(others, "")))
    title = "Friction laws: residual of the torque of held-out windows in motion; plain is "
    header = ("joint", "friction law", "held out/%", "plain/%", "best other law, %")
    return (Table(header, rows, (0, 1, 4), f"{title}coulomb-viscous-offset."),)


def show_laws(laws: "Sequence[estimators.FittedLaw]") -> Iterator[Block]:
    """Yield what a page shows of friction laws, and how one was chosen where there was a choice."""
    if laws:
        yield from ("== Friction laws ==", *tabulate_laws(laws))
    for entry in laws:
        if entry.selection is not None and len(entry.selection.trials) > 1:
            title = f"=== {entry.joint}: {entry.law} ==="
            yield from (title, entry.selection.verdict, show_law_trials(entry.selection))


def _describe_refused(refused: "Sequence[tuple[str, str]]", key: str = "name") -> list[dict[str, str]]:
    return [{key: name, "reason": reason} for name, reason in refused]


def describe_validation(validation: "estimators.Validation") -> dict[str, object]:
    """Return the validation as `symid validate --json` gives it."""
    return {
        **describe_record(validation),
        "mean_relative_percent": validation.mean_relative_percent,
        "scoring": validation.scoring or None,
        "motion": [_describe_motion_parts(entry) for entry in validation.motion],
    }


def _describe_motion_parts(motion: "estimators.MotionResidual") -> dict[str, object]:
    parts = zip(("motion", "reversal", "rest"), motion.rms, motion.rows, strict=True)
    phases = {name: {"rms": rms, "rows": rows} for name, rms, rows in parts}
    head = {"joint": motion.joint, "unit": motion.unit}
    return {**head, **phases, "left_out": motion.left_out, "all_rows_rms": motion.whole}


def show_all_rows(validation: "estimators.Validation") -> str:
    """Return the residual of all rows in a line, where others count; empty where they do."""
    if not validation.scoring:
        return ""
    parts = ", ".join(f"{entry.joint} {entry.relative_percent:.4f} %" for entry in validation.all_rows)
    return (
        f"measured and predicted torques: both low-pass at {validation.scoring:.3g} Hz, the band that the "
        f"fit was chosen by; of all samples, without that low-pass: {parts}"
    )


def show_estimate(estimate: "estimators.Estimate", *, brief: bool = False) -> tuple[Block, ...]:
    """Return a headline, the tables, how a simulation went, and what is not identifiable.

    `brief` leaves the residual of all rows out where there is one of what was held out.
    """
    headline = (
        f"{estimate.robot}: {estimate.rows}, {estimate.estimator}, {estimate.samples} equations, condition "
        f"{estimate.condition:.3g}: {estimate.ending}"
    )
    truth = {"truth": "truth", "within 3 std": "near_truth"} if estimate.simulated else _STATED
    table = _show_parameters(estimate.parameters, ".3g", truth)
    lines = []
    fit: Any = estimate.settings.get("fit")
    if isinstance(fit, Mapping) and "tracking" in fit:
        # Output-error estimators simulate.
        times = f"{fit['iterations']} simulation{'s'[: fit['iterations'] > 1]} of the controlled robot"
        lines = [f"started from {fit['start']}; {times}"]
        lines += [
            "{joint}: simulated positions {simulated_from_measured:.3g} {unit} (rms) from the measured ones, "
            "the reference {reference_from_measured:.3g} {unit}".format(**entry)
            for entry in fit["tracking"]
        ]
        if "wls" in fit:
            lines.append(fit["wls"]["verdict"])
    refused = [f"refused: {name}: {reason}" for name, reason in estimate.refused]
    texts = ("\n".join(part) for part in (lines, refused) if part)
    held_out = () if estimate.evidence is None else (show_evidence(estimate.evidence),)
    laws = tabulate_laws(estimate.laws)
    mounting: Any = estimate.settings.get("mounting", {})
    said = ("\n".join(mounting["said"]),) if mounting else ()
    residual = () if brief and held_out else (show_residual(estimate.residual),)
    return (headline, *said, table, *laws, *residual, *held_out, *texts)


def _show_parameters(
    parameters: "Sequence[estimators.ParameterEstimate]", form: str, beside: Mapping[str, str]
) -> Table:
    """Return values with deviations, percent in a format; where any truth is known, fields `beside` them."""
    known = beside if any(entry.truth is not None for entry in parameters) else {}
    rows = list[Sequence[object]]()
    for entry in parameters:
        percent = format(entry.relative_std_percent, form) if form else entry.relative_std_percent
        truth = (getattr(entry, field) for field in known.values())
        rows.append((entry.name, entry.value, entry.std, percent, entry.unit, *truth))
    return Table(("parameter", "value", "std", "std/%", "unit", *known), rows, (0, 4))


def show_residual(residual: Sequence["estimators.Residual"]) -> Table:
    """Return the table of residuals."""
    rows = []
    for e in residual:
        # A joint without a motor has no torque that a residual could be a part of.
        share = f"{e.relative_percent:.4f}" if math.isfinite(e.relative_percent) else ""
        rows.append((e.joint, e.norm, share, e.std, e.unit, e.samples))
    return Table(("joint", "norm", "relative/%", "std", "unit", "samples"), rows, (0, 4))


def show_evidence(evidence: "estimators.Evidence") -> Table:
    """Return the table of what is left of held-out stretches, joint by joint."""
    parts = f"{evidence.logs} logs" if evidence.logs else f"{evidence.stretches} stretches"
    rows = [
        (
            *(entry.joint, f"{entry.fitted:.3g}", f"{entry.held_out:.3g}"),
            *(f"{value:.3g}" if math.isfinite(value) else "" for value in (entry.moving, entry.slow)),
            *(f"{100.0 * entry.share:.3g}", f"{entry.torque:.3g}"),
        )
        for entry in evidence.joints
    ]
    header = ("joint", "fit/%", "held out/%", "fast/%", "slow/%", "samples left out/%")
    title = (
        f"Residual below {evidence.scoring:.3g} Hz, relative to the torque; cross-validation over {parts}."
    )
    return Table((*header, "torque rms"), rows, title=title)


def show_tests(evidence: "estimators.Evidence") -> Table:
    """Return the table of what estimates from different rows say of each other."""
    rows = []
    for entry in evidence.tests:
        numbers = (f"{value:.2g}" for value in (entry.size, entry.bound, entry.p))
        rows.append((entry.what, entry.part, entry.joint, entry.verdict, *numbers))
    header = ("samples", "log", "joint", "estimates", "differ by/%", "at most/%", "p")
    title = "Estimates from different samples, by the torque that they predict, in percent of it."
    return Table(header, rows, (0, 1, 2, 3), title)


def show_motion(motion: Sequence["estimators.MotionResidual"]) -> tuple[Table, ...]:
    """Return the table of residuals in motion, at reversal and at rest; nothing of rows without phases."""
    if not motion:
        return ()
    left_out = any(entry.left_out for entry in motion)
    header = ("joint", "in motion", "at reversal", "at rest", "unit")
    rows = list[Sequence[object]]()
    for entry in motion:
        pairs, whole = zip(entry.rms, entry.rows, strict=True), sum(entry.rows)
        phases = ("" if rms is None else f"{rms:.4g} ({100.0 * n / whole:.3g} %)" for rms, n in pairs)
        more = (entry.left_out or "", f"{entry.whole:.4g}") if left_out else ()
        rows.append((entry.joint, *phases, entry.unit, *more))
    title = "RMS of the residual of all samples, and their share; at reversal: below 5 % of the top speed."
    return (Table((*header, *(("left out", "all samples") if left_out else ())), rows, (0, 4), title),)


def describe_alignment(alignment: "Alignment", joints: Sequence[str]) -> dict[str, object]:
    """Return delay and offsets: one object a run, one entry a joint; null where they are not identifiable."""

    def name(values: "FloatArray") -> dict[str, float]:
        return dict(zip(joints, values.tolist(), strict=True))

    runs = zip(alignment.sources, alignment.offsets, alignment.offset_stds, strict=True)
    return {
        "delay_ms": 1e3 * alignment.delay,
        "delay_std_ms": 1e3 * alignment.delay_std,
        "joint_delays_ms": name(1e3 * alignment.delays),
        "delay_explains": name(alignment.explained),
        "offsets": [{"log": log, "offsets": name(values), "std": name(stds)} for log, values, stds in runs],
    }


def describe_stiffness(found: "StiffnessEstimate") -> dict[str, object]:
    """Return the result as `symid identify --method stiffness --json` gives it."""
    joints = list(map(describe_record, found.joints))
    for plain, entry in zip(joints, found.joints, strict=True):
        plain |= {"verdict": entry.verdict.name.lower(), "identified": entry.stiffness is not None}
    return {
        "robot": found.robot,
        "method": "stiffness",
        **describe_alignment(found.alignment, [entry.joint for entry in found.joints]),
        "joints": joints,
        "interval_method": f"95 %, Student's t, jackknife over {found.blocks} blocks of about a second",
        "hysteresis": None,
        "hysteresis_reason": "a spring was fitted and nothing else: no hysteresis is claimed",
        "sources": found.alignment.sources,
    }


def show_stiffness(found: "StiffnessEstimate") -> tuple[Block, ...]:
    """Return how many joints have one, the delay, the zero offsets of each run, stiffnesses and reasons."""
    known = sum(entry.stiffness is not None for entry in found.joints)
    alignment = found.alignment
    std, delay = 1e3 * alignment.delay_std, 1e3 * abs(alignment.delay)
    text = f"no significant delay between link and motor encoders (standard deviation {std:.2g} ms)"
    if alignment.late:
        verb = "lag" if alignment.delay > 0.0 else "lead"
        text = f"link encoders {verb} motor encoders by {delay:.3f} ms (standard deviation {std:.3f} ms)"
    runs = zip(alignment.sources, alignment.offsets, alignment.offset_stds, strict=True)
    rows = [
        (entry.joint, source, values[index], stds[index], 100.0 * alignment.explained[index])
        for source, values, stds in runs
        for index, entry in enumerate(found.joints)
        if alignment.present[index]
    ]
    header = ("joint", "stiffness", "from", "to (95 %)", "unit", "explained/1e-6", "residual/1e-6", "verdict")
    springs = []
    for entry in found.joints:
        sizes = (1e6 * entry.explained, 1e6 * entry.left, entry.verdict.name.lower().replace("_", " "))
        springs.append((entry.joint, entry.stiffness, *(entry.interval or (None, None)), entry.unit, *sizes))
    return (
        f"{found.robot}: the stiffness of {known} of {len(found.joints)} joints is identifiable",
        text,
        Table(("joint", "log", "zero offset", "std", "explained by delay/%"), rows, left=(0, 1)),
        Table(header, springs, (0, 4, 7)),
        "\n".join(f"{entry.joint}: {entry.reason}" for entry in found.joints),
    )


def describe_elastic(estimate: "ElasticEstimate") -> dict[str, object]:
    """Return the estimate of elastic joints as `symid identify --json` gives it."""
    found = describe_record(estimate)
    del found["friction"]
    for plain, trial in zip(found["trials"], estimate.trials, strict=True):
        plain["outcome"] = trial.outcome.name.lower()
    return {
        **found,
        "parameters": [_describe_parameter(entry) for entry in estimate.parameters],
        "effects": [_describe_effect(estimate, effect) for effect in estimate.effects],
        "outcome": describe_outcome(estimate.outcome),
        "refused": _describe_refused(estimate.refused),
    }


def show_elastic(estimate: "ElasticEstimate") -> tuple[Block, ...]:
    """Return a headline, why the method was chosen, the tables, and what is not identifiable."""
    rows = [
        (trial.method, trial.error, "chosen" if trial.method == estimate.method else "", trial.outcome.value)
        for trial in estimate.trials
    ]
    trials = Table(("method", "prediction error", "choice", "outcome"), rows, (0, 2, 3))
    return (
        f"{estimate.robot}: {estimate.method}, condition {estimate.condition:.3g}: {estimate.outcome.value}",
        f"{estimate.reason[:1].upper()}{estimate.reason[1:]}.",
        show_elastic_parameters(estimate),
        *tabulate_laws(estimate.laws),
        *([show_springs(estimate)] if estimate.springs else []),
        *([show_effects(estimate)] if estimate.effects else []),
        show_residual((*estimate.residual, estimate.energy)),
        *([trials] if len(estimate.trials) > 1 else []),
        *(f"refused: {name}: {reason}" for name, reason in estimate.refused),
    )


def show_elastic_parameters(estimate: "ElasticEstimate") -> Table:
    """Return the table of dynamic parameters, beside them the truth or the values of the robot file."""
    truth = {"truth": "truth", "error/%": "error_percent"} if estimate.simulated else _STATED
    return _show_parameters(estimate.parameters, "", truth)


def show_springs(estimate: "ElasticEstimate") -> Table:
    """Return the table of springs: stiffness left and at small torsion, and how far they were excited."""
    told = [entry for entry in estimate.springs if entry.identifiable]
    branched, rows = any(entry.elasticity.branches for entry in told), list[Sequence[object]]()
    for entry in told:
        spring, unit = entry.elasticity, f"{entry.torque_unit}/{entry.position_unit}"
        stops, knees = len(spring.stops), len(spring.knees)
        slope = joint_models.find_most_slope(spring) if branched else spring.initial_stiffness
        names: list[object] = [stops, knees]
        if branched:
            counts = [f"{count} {name}" for count, name in ((stops, "stops"), (knees, "knees")) if count]
            names = [", ".join([*(branch.kind for branch in spring.branches), *counts]) or "linear"]
        slipped = () if branched else (entry.excited,)
        start = (entry.joint, spring.stiffness, slope, entry.slope_std, unit)
        rows.append((*start, *names, entry.torsion, *slipped, entry.torque, entry.torque_std))
    middle = ["branches", "torsion"] if branched else ["stops", "knees", "torsion", "slipped to"]
    steepest = "at most" if branched else "k0 + stops"
    header = ("joint", "k0", steepest, "slope std", "unit", *middle, "torque", "torque std")
    return Table(header, rows, (0, 4, 5) if branched else (0, 4))


def _describe_effect(estimate: "ElasticEstimate", effect: "DriveEffect") -> dict[str, object]:
    torque = estimate.residual[max(effect.joint, 0)].unit
    unit = _EFFECTS[effect.kind][1].format(torque=torque, position="m" if torque == "N" else "rad")
    joint = "all" if effect.joint < 0 else estimate.residual[effect.joint].joint
    return {**describe_record(effect), "joint": joint, "unit": unit}


def show_effects(estimate: "ElasticEstimate") -> Table:
    """Return the table of what drives, gears and links add: amplitudes of waves, and their order."""
    rows = []
    for effect in estimate.effects:
        plain = _describe_effect(estimate, effect)
        size = math.hypot(*effect.values)
        order = f"{effect.order:.6g}" if effect.order else ""
        values = (f"{size if effect.order else effect.values[0]:.4g}", f"{effect.deviations[0]:.2g}")
        rows.append((plain["joint"], _EFFECTS[effect.kind][0], order, *values, plain["unit"]))
    title = "Taken off before the fit; an order N is of waves cos(N theta), theta on the joint side."
    return Table(("joint", "effect", "order", "value", "std", "unit"), rows, (0, 1, 5), title)


def describe_friction(found: "FrictionIdentification") -> dict[str, object]:
    """Return the result as `symid identify --rows friction --json` gives it."""
    joints = []
    for entry in found.joints:
        estimate, poses = entry.estimate, entry.poses
        own, rigid = (list(map(_describe_parameter, part)) for part in (estimate.parameters, estimate.extra))
        for value in (*own, *rigid):
            del value["truth"]
            value["meaning"], value["remark"] = value.pop("expression"), value.pop("reason")
        plain = {
            **describe_record(estimate),
            **describe_record(entry),
            "parameters": own,
            "rigid": {"text": entry.rigid, "parameters": rigid},
            "refused": _describe_refused(estimate.refused),
            "motion": None if entry.motion is None else _describe_motion_parts(entry.motion),
            "outcome": describe_outcome(estimate.outcome),
            "poses": poses
            and {
                **describe_record(poses),
                "poses": [{"others": dict(pose.others), "sources": pose.sources} for pose in poses.poses],
                "skipped": _describe_refused(poses.skipped, "sources"),
                "parameters": [{**describe_record(e), "interval_95": e.intervals} for e in poses.parameters],
            },
        }
        joints.append(plain)
    plain = {**describe_record(found), "rows": "friction", "joints": joints}
    del plain["friction"]
    return {**plain, "refused": _describe_refused(found.refused, "joint")}


def show_friction(found: "FrictionIdentification") -> tuple[Block, ...]:
    """Return all that is found of a robot, joint by joint, and why it is not of the others."""
    size = len(found.joints) + len(found.refused)
    parts: list[Block] = [f"{found.robot}: friction of {len(found.joints)} of {size} joint{'s'[: size > 1]}"]
    for entry in found.joints:
        estimate, residual = entry.estimate, entry.residual
        parts.append(f"== {entry.joint}: {estimate.law}, {estimate.estimator} ==")
        if entry.selection is not None:
            parts += [show_law_trials(entry.selection), _wrap(entry.selection.verdict)]
        parts.append(f"{_wrap(entry.formula)}\n{_wrap(f'{estimate.outcome.value}; {estimate.ended}')}")
        # Beyond J, a and b they are groups whose values say nothing by themselves.
        rigid = estimate.extra if len(estimate.extra) <= _SHOWN else ()
        shown = (*estimate.parameters, *rigid)
        table = _show_parameters(shown, ".3g", {})
        meanings = ("rigid part" if line in rigid else line.reason or line.expression for line in shown)
        rows = [(*row, meaning) for row, meaning in zip(table.rows, meanings, strict=True)]
        rms = f"{residual.std:.4g} {residual.unit} RMS over {residual.samples} samples"
        parts += [
            Table((*table.header, "meaning"), rows, (0, 4, 5)) if shown else "no parameter is identifiable",
            _wrap(f"{entry.rigid}; residual {residual.relative_percent:.4f} % of the torque, {rms}"),
        ]
        motion = entry.motion
        if motion is not None:
            words = zip(("in motion", "at reversal", "at rest"), motion.rms, motion.rows, strict=True)
            text = ", ".join(
                f"{name} {rms:.4g} {motion.unit} ({100.0 * rows / sum(motion.rows):.3g} % of the samples)"
                for name, rms, rows in words
                if rms is not None
            )
            if motion.left_out:
                whole = f"{motion.whole:.4g} {motion.unit}"
                text += f"; {motion.left_out} of these samples were left out above, all of them have {whole}"
            parts.append(_wrap(f"RMS {text}"))
        if entry.poses is not None:
            parts += [*show_poses(entry.poses), _wrap(f"{entry.poses.verdict}.")]
        if estimate.refused:
            parts.append("\n".join(_wrap(f"refused: {name}: {reason}") for name, reason in estimate.refused))
    refused = [_wrap(f"{name}: {reason}") for name, reason in found.refused]
    return (*parts, *(["\n".join(refused)] if refused else []))


def list_friction(found: "FrictionIdentification") -> tuple[Block, ...]:
    """Return the law of each joint with its values, and why there is none of the others."""
    rows = [
        (
            entry.joint,
            entry.estimate.law,
            ", ".join(f"{one.name} {one.value:.4g} +- {one.std:.2g}" for one in entry.estimate.parameters),
            entry.residual.relative_percent,
        )
        for entry in found.joints
    ]
    table = Table(("joint", "law", "values, SI units", "residual/%"), rows, (0, 1, 2), fold=_WIDTH // 2)
    return (show_friction(found)[0], table, *(f"refused: {name}: {text}" for name, text in found.refused))


def show_law_trials(selection: "estimators.LawSelection", title: str = "") -> Table:
    """Return the table of the laws that were compared, by torques held back."""
    rows = list[Sequence[object]]()
    for trial in selection.trials:
        percent = (write_number(value, ".4f") for value in (trial.fitted_percent, trial.held_percent))
        distance = (write_number(trial.ratio, ".4f"), write_number(trial.behind, ".1f"))
        choice = "chosen" if trial.law == selection.chosen else trial.reason
        rows.append((trial.law, trial.unknowns, *percent, trial.held_rms, *distance, choice))
    header = ("law", "unknowns", "fitted/%", "held out/%", "RMS", "squares", "behind/se", "choice")
    return Table(header, rows, (0, 7), title)


def show_poses(poses: "PoseTest") -> tuple[Block, ...]:
    """Return the intervals of every parameter pose by pose, and where the poses are."""
    header = ("parameter", *(f"pose {k}, 95 %" for k in range(1, len(poses.poses) + 1)), "unit", "chance")
    rows = []
    for entry in poses.parameters:
        intervals = (f"{low:.4g} .. {high:.4g}" for low, high in entry.intervals)
        rows.append((entry.name, *intervals, entry.unit, f"{entry.chance:.2g}"))
    places = (", ".join(f"{name} {place:.3g}" for name, place in pose.others) for pose in poses.poses)
    pairs = enumerate(zip(places, poses.poses, strict=True), start=1)
    lines = [f"pose {number}: {others} ({', '.join(pose.sources)})" for number, (others, pose) in pairs]
    lines += [_wrap(f"left out: {sources}: {reason}") for sources, reason in poses.skipped]
    text = "\n".join(lines)
    return (Table(header, rows, left=(0, len(poses.poses) + 1), title=text) if rows else text,)


def write_number(value: float | None, form: str) -> str:
    """Return a number as a cell, empty where there is none."""
    return "" if value is None else format(value, form)


def _wrap(text: str) -> str:
    return textwrap.fill(text, width=_WIDTH)
