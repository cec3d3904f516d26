"""Results as text for terminals and pages, and as objects for JSON: logs, trajectories, fits, comparisons."""

import math
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from symid import joint_models, logs
from symid.environment import show_path
from symid.errors import Notice
from symid.report.blocks import Block, Table, describe_outcome, format_pair
from symid.robot import Robot
from symid.serialization import describe_record, write_plain

if TYPE_CHECKING:
    from symid.arrays import FloatArray
    from symid.dynamics import OpenReading
    from symid.excitation import OptimisedExcitation
    from symid.identification import Compared, EstimateSide, TriedReading, estimators
    from symid.identification.elastic import DriveEffect, ElasticEstimate, StiffnessEstimate
    from symid.identification.friction import FrictionIdentification, PoseTest
    from symid.identification.rigid import LogExcitation, LogsCheck
    from symid.logs import Alignment, JointSummary

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
_SINGULAR = 12
"""Singular values on either side of the rank."""
_VERDICTS = ("identifiable", "poorly identifiable", "not identifiable")
_GROUP_WIDTH = 44
"""Letters of a group on one line of a table."""
_TINY = 1e-12
_TOO_SURE = 0.999
_LIMITS = ((2.0, 0.9545), (3.0, 0.9973))
"""Numbers of deviations, and the share of normal errors within them."""


# Robots, logs and trajectories.


def summarise_robot(robot: Robot) -> str:
    """Return name, joints and convention."""
    others = {"urdf": "URDF", "mjcf": "MJCF", "origin": "frames by origin"}
    convention = others.get(robot.convention, f"{robot.convention} DH")
    return f"{robot.name}, {robot.size} joint{'s'[: robot.size != 1]}, {convention}"


def show_robot_check(robot: Robot, checked: "LogsCheck", *, brief: bool = False) -> tuple[Block, ...]:
    """Return what was read, the joints of every log, and the identifiability; if `brief` where it lacks."""
    head = f"{robot.path}: {summarise_robot(robot)}: no mistakes"
    if not checked.logs:
        return (head,)
    header = ("log", "samples", "duration/s", "period/s", "velocity", "second encoder")
    rows = list[Sequence[object]]()
    for log, timing in ((entry.recording, entry.timing) for entry in checked.logs):
        channels = (log.velocity is not None, logs.get_second_encoder_side(log))
        rows.append((log.source, timing.samples, timing.duration, log.period, *channels))
    blocks: list[Block] = [Table(header, rows, (0, 5), head)]
    blocks += [show_joints(log.recording.source, log.joints) for log in checked.logs]
    if checked.copy is not None:
        file, notice = checked.copy
        blocks.append(f"{show_path(file)}: {notice.text}")
    found = checked.excitation
    if found is not None:
        verdicts = [entry.verdict for entry in found.parameters]
        counts = ", ".join(f"{verdicts.count(name)} {name}" for name in _VERDICTS if name in verdicts)
        first = max(0, found.rank - _SINGULAR // 2)
        shown = [f"{value:.2g}" for value in found.singular[first : first + _SINGULAR]]
        shown.insert(found.rank - first, "|")
        text = f"Identifiability: {counts}; condition {found.condition:.3g}\n"
        text += f"singular values of the scaled matrix about its rank {found.rank} of {len(found.singular)}: "
        text += f"{'... ' if first else ''}{' '.join(shown)}"
        if brief:
            weak = tuple(entry for entry in found.parameters if entry.verdict != _VERDICTS[0])
            found = replace(found, parameters=weak)
        blocks += [text, *[show_identifiable(found, "std/%")] * bool(found.parameters)]
    return tuple(blocks)


def show_identifiable(
    found: "LogExcitation", name: str, write: Callable[[float], object] = float, title: str = ""
) -> Table:
    """Return the verdict on every parameter, with the deviation to expect, called `name`, and the reason."""
    rows = [(e.name, e.verdict, write(e.relative_std_percent), e.reason) for e in found.parameters]
    return Table(("parameter", "verdict", name, "why"), rows, (0, 1, 3), title, worst=2)


def show_joints(source: str, joints: "tuple[JointSummary, ...]") -> Table:
    """Return the table of a log's joints."""
    header = ("joint", "from", "to", "top speed", "unit", "step", "still/%", "rms torque", "peak")
    rows = []
    for joint in joints:
        motion = (
            joint.low,
            joint.high,
            joint.speed,
            joint.unit,
            joint.step or None,
            100.0 * joint.standstill,
        )
        rows.append((joint.name, *motion, joint.torque, joint.peak, 100.0 * joint.saturated))
    return Table((*header, "at peak/%"), rows, (0, 4), source)


def describe_gain(factor: float) -> str:
    """Return how much smaller a condition number is than that of the best random trajectory."""
    return f"{factor:.2f} times smaller" if factor >= 1.0 else "no smaller"


def show_excitation(found: "OptimisedExcitation") -> tuple[Block, ...]:
    """Return the figures of a trajectory, the part of each limit that it uses, and clearances."""
    known = [margin for margin in found.margins if margin.share is not None]
    shares = {(margin.kind, margin.name): f"{margin.share:.1%}" for margin in known}
    kinds, names = (tuple(dict.fromkeys(key[place] for key in shares)) for place in (0, 1))
    rows = [[name, *(shares.get((kind, name)) for kind in kinds)] for name in names]
    head = f"{found.trajectory.source}, {found.trajectory.duration:g} s\ncondition number of the regressor "
    head += f"(column-scaled): {found.condition:.4g}\n  best of the random feasible trajectories "
    head += f"{found.random_condition:.4g}, their median {found.random_median:.4g}; "
    head += f"{describe_gain(found.factor)} than the best\ninformation per parameter (mean logarithm): "
    head += f"{found.information:.4g}, most of the random ones {found.random_information:.4g}"
    title = "part of each limit that is used, at most:"
    places = [[margin.name, margin.value] for margin in found.margins if margin.share is None]
    clearances = [Table(("place", "least clearance/m"), places)] if places else []
    return (head, Table(("joint", *kinds), rows, title=title), *clearances)


# Fits.


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
    headline = f"{estimate.robot}: {estimate.rows}, {estimate.estimator}, {estimate.samples} equations, "
    headline += f"condition {estimate.condition:.3g}: {estimate.ending}"
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
    return Table(("parameter", "value", "std", "std/%", "unit", *known), rows, (0, 4), worst=3)


def show_residual(residual: Sequence["estimators.Residual"]) -> Table:
    """Return the table of residuals; the figures of a row are those of the same samples."""
    rows = []
    for e in residual:
        # A joint without a motor has no torque that a residual could be a part of.
        share = f"{e.relative_percent:.4f}" if math.isfinite(e.relative_percent) else ""
        rows.append((e.joint, e.norm, share, e.norm / math.sqrt(max(1, e.samples)), e.unit, e.samples))
    return Table(("joint", "norm", "relative/%", "rms", "unit", "samples"), rows, (0, 4))


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
    title = f"Residual below {evidence.scoring:.3g} Hz, relative to the torque; cross-validation over "
    title += f"{parts}."
    return Table((*header, "torque rms"), rows, title=title, worst=2)


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
        (entry.joint, source, format_pair(values[index], stds[index]), 100.0 * alignment.explained[index])
        for source, values, stds in runs
        for index, entry in enumerate(found.joints)
        if alignment.present[index]
    ]
    header = ("joint", "stiffness", "from", "to (95 %)", "unit", "by gravity", "residual", "verdict")
    springs = []
    for entry in found.joints:
        small = f"m{entry.unit.rpartition('/')[2]}"
        sizes = (f"{1e3 * size:.3g} {small}" for size in (entry.explained, entry.left))
        verdict = entry.verdict.name.lower().replace("_", " ")
        spring = (entry.stiffness, *(entry.interval or (None, None)), entry.unit)
        springs.append((entry.joint, *spring, *sizes, verdict))
    return (
        f"{found.robot}: the stiffness of {known} of {len(found.joints)} joints is identifiable",
        text,
        Table(("joint", "log", "zero offset (rad or m)", "explained by delay/%"), rows, left=(0, 1)),
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


# Comparisons.


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
        pairs = (value.theirs, value.theirs_std), (value.ours, value.ours_std)
        rows.append((value.group, *(format_pair(*pair) for pair in pairs), *away))
    header = ["group", "other", "ours", "in std", *(["read as"] if read else [])]
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
    judged, total = comparison.judged, comparison.chi_square
    agreement = ", ".join(
        f"{comparison.count_within(limit)} of {judged} within {limit:g} standard deviations "
        f"({share * judged:.0f} expected)"
        for limit, share in _LIMITS
    )
    if not judged:
        agreement = "neither side states standard deviations: agreement cannot be judged"
    elif total is None:
        agreement += "\nno chi-square: the covariance of the differences is singular"
    else:
        agreement += f"\nchi-square {_format_deviations(total.value)} over {total.freedom} groups"
        if other.shared:
            agreement += "; no probability, because the estimates have logs in common"
        else:
            chance = f"{total.chance:.2g}" if total.chance > _TINY else f"below {_TINY:g}"
            agreement += f", probability {chance}"
            if total.chance > _TOO_SURE:
                agreement += "; too small for independent errors: both may come from the same log"
        if total.stretch > 1.0:
            large = f"{total.stretch:.2g} times as large"
            agreement += f"; it would be as expected with standard deviations {large}"
    left_out = (
        ("ours, not in the other: ", found.absent),
        ("in neither: ", found.neither),
        ("", (span,)),
        ("the other's, refused in ours: ", found.not_ours),
        ("the other's, of another model: ", found.other.strange),
    )
    return (
        f"{ours.identified.robot.name}: {show_path(ours.source)} beside {show_path(other.source)}{columns}",
        Table(header, rows, left=(0, 4) if read else (0,), fold=_GROUP_WIDTH),
        agreement,
        *(["\n".join(lines)] if len(lines) > 1 else []),
        "\n".join(f"{head}{', '.join(names)}" for head, names in left_out if names),
    )


def _format_deviations(value: float, sign: str = "", digits: int = 1) -> str:
    """Return a number of deviations; beyond a hundred thousand its size is enough."""
    if math.isnan(value):
        return "-"
    return format(value, f"{sign}.{digits}f" if abs(value) < 1e5 else f"{sign}.2e")


def describe_compared(found: "Compared") -> dict[str, object]:
    """Return the comparison with one other as `symid compare --json` gives it."""
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


def warn_compared(found: "Compared") -> Iterator[Notice]:
    """Yield the warnings on one other: shared logs, terms that groups seem to contain."""
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
        text = f"both estimates were fitted to {', '.join(found.other.shared)}: their errors are not "
        text += "independent, and differences should be smaller than deviations; compare fits of other logs"
        yield Notice(code="compare.shared-logs", text=text, file=file)
    for coupling in dict.fromkeys(reading.coupling for reading, _ in found.readings if reading.coupling):
        entries = [entry for entry in found.readings if entry[0].coupling == coupling]
        sure = [entry for entry in entries if entry[1].decisive]
        if not sure:
            continue
        text = f"{'; '.join(describe(*entry) for entry in sure)}. The other seems to count what "
        text += f"drive {coupling!r} adds to a single joint to that joint (an inference); to compare so: "
        text += f"{' '.join(write_option(reading) for reading, _ in sure)}"
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
