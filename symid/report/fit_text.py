"""Results of an identification as text, and as objects for JSON."""

import math
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from symid.report.blocks import Block, Table, describe_outcome, select_fields, tabulate
from symid.serialization import write_plain

if TYPE_CHECKING:
    from symid.identification.diagnostics import BandResidual
    from symid.identification.elastic import DriveEffect, ElasticEstimate, SpringEstimate, StiffnessEstimate
    from symid.identification.estimators import (
        Estimate,
        Evidence,
        FittedLaw,
        LawSelection,
        LawTrial,
        MotionResidual,
        ParameterEstimate,
        Residual,
        Validation,
    )
    from symid.identification.friction import FrictionIdentification, JointFriction, PoseTest
    from symid.logs import Alignment


_PARAMETER = "name value std relative_std_percent unit"
_TRIAL = (
    "law unknowns fitted_percent held_percent held_rms squared_error_ratio=ratio "
    "standard_errors_behind=behind aicc reason"
)


def describe_estimate(estimate: "Estimate") -> dict[str, object]:
    """Return the estimate as `symid identify --json` gives it."""
    return {
        **select_fields(estimate, "robot rows estimator friction"),
        "parameters": [
            select_fields(entry, f"{_PARAMETER} expression truth") for entry in estimate.parameters
        ],
        "residual": describe_residual(estimate.residual),
        **select_fields(estimate, "mean_relative_percent condition"),
        "outcome": describe_outcome(estimate.outcome),
        "refused": _describe_refused(estimate.refused),
        **select_fields(estimate, "samples sources settings signature"),
        "laws": [_describe_law(entry) for entry in estimate.laws],
        "choice": write_plain(estimate.choice),
        "evidence": write_plain(estimate.evidence),
    }


def _describe_law(entry: "FittedLaw") -> dict[str, object]:
    shape = dict(zip(entry.names, entry.shape, strict=True))
    selection = entry.selection
    return {
        **select_fields(entry, "joint law smoothing"),
        "shape": shape,
        "selection": None
        if selection is None
        else {
            **select_fields(selection, "chosen verdict blocks"),
            "trials": [select_fields(trial, _TRIAL) for trial in selection.trials],
        },
    }


def tabulate_laws(laws: "Sequence[FittedLaw]") -> tuple[Block, ...]:
    """Return what was found of the friction laws of all joints; nothing where none were searched."""
    if not laws:
        return ()

    def get_trial(entry: "FittedLaw", law: str) -> "LawTrial | None":
        trials = entry.selection.trials if entry.selection is not None else ()
        return next((trial for trial in trials if trial.law == law), None)

    def write_percent(trial: "LawTrial | None") -> str:
        return "" if trial is None or trial.held_percent is None else f"{trial.held_percent:.3g}"

    def write_next(entry: "FittedLaw") -> str:
        trials = entry.selection.trials if entry.selection is not None else ()
        other = next((one for one in trials if one.law != entry.law and not one.reason), None)
        return "" if other is None else f"{other.law} {write_percent(other)}"

    table = tabulate(
        laws,
        "joint; friction law=law; held out/%=own; plain/%=plain; best other law, %=other",
        (0, 1, 4),
        "Friction laws: what each leaves of the torque of held-out windows in motion; plain is "
        "coulomb-viscous-offset.",
        own=lambda entry: write_percent(get_trial(entry, entry.law)),
        plain=lambda entry: write_percent(get_trial(entry, "coulomb-viscous-offset")),
        other=write_next,
    )
    return (table,)


def _describe_refused(refused: "Sequence[tuple[str, str]]", key: str = "name") -> list[dict[str, str]]:
    return [{key: name, "reason": reason} for name, reason in refused]


def describe_validation(validation: "Validation") -> dict[str, object]:
    """Return the validation as `symid validate --json` gives it."""
    return {
        **select_fields(validation, "robot log=source rows samples mean_relative_percent"),
        "residual": describe_residual(validation.residual),
        "scoring": validation.scoring or None,
        "all_rows": describe_residual(validation.all_rows),
        "motion": [describe_motion_parts(entry) for entry in validation.motion],
    }


def describe_motion_parts(motion: "MotionResidual") -> dict[str, object]:
    """Return one joint's residual by the phases of motion."""
    parts = zip(("motion", "reversal", "rest"), motion.rms, motion.rows, strict=True)
    return {
        "joint": motion.joint,
        "unit": motion.unit,
        **{name: {"rms": rms, "rows": rows} for name, rms, rows in parts},
        "left_out": motion.left_out,
        "all_rows_rms": motion.whole,
    }


def show_all_rows(validation: "Validation") -> str:
    """Return the residual of all rows in a line, where others count; empty where they do."""
    if not validation.scoring:
        return ""
    parts = ", ".join(f"{entry.joint} {entry.relative_percent:.4f} %" for entry in validation.all_rows)
    return (
        f"torques and what is predicted: both low-pass at {validation.scoring:.3g} Hz, the band that the fit "
        f"was chosen by; of all rows, without that low-pass: {parts}"
    )


def describe_residual(residual: Sequence["Residual"]) -> list[dict[str, object]]:
    """Return one object a joint."""
    return [select_fields(entry, "joint norm relative_percent std samples unit") for entry in residual]


def show_estimate(estimate: "Estimate") -> tuple[Block, ...]:
    """Return a headline, the tables, how a simulation went, and what is not identifiable."""
    headline = (
        f"{estimate.robot}: {estimate.rows} rows, {estimate.estimator}, {estimate.samples} equations, "
        f"condition {estimate.condition:.3g}: {estimate.outcome.value}"
    )
    table = _tabulate_parameters(
        estimate.parameters, ":.3g; unit", "; robot file=truth; within 3 std=near_truth"
    )
    lines = []
    fit: Any = estimate.settings.get("fit")
    if isinstance(fit, Mapping) and "tracking" in fit:
        # Output-error estimators simulate.
        count = fit["iterations"]
        lines.append(
            f"started from {fit['start']}; {count} simulation{'s'[: count > 1]} of the controlled robot"
        )
        lines += [
            f"{entry['joint']}: simulated positions {entry['simulated_from_measured']:.3g} {entry['unit']} "
            f"(rms) from the measured ones, the reference {entry['reference_from_measured']:.3g} "
            f"{entry['unit']}"
            for entry in fit["tracking"]
        ]
        if "wls" in fit:
            lines.append(fit["wls"]["verdict"])
    refused = "\n".join(f"refused: {name}: {reason}" for name, reason in estimate.refused)
    texts = filter(None, ("\n".join(lines), refused))
    held_out = () if estimate.evidence is None else (show_evidence(estimate.evidence),)
    laws = tabulate_laws(estimate.laws)
    return (headline, table, *laws, show_residual(estimate.residual), *held_out, *texts)


def _tabulate_parameters(parameters: "Sequence[ParameterEstimate]", columns: str, true: str) -> Table:
    """Return the table of parameters, with the columns `true` where the robot file states their values."""
    known = any(entry.truth is not None for entry in parameters)
    columns = f"parameter=name; value; std; std/%=relative_std_percent{columns}{true if known else ''}"
    return tabulate(parameters, columns, (0, 4))


def show_residual(residual: Sequence["Residual"], title: str = "") -> Table:
    """Return the table of residuals."""
    columns = "joint; norm; relative/%=relative_percent:.4f; std; unit; samples"
    return tabulate(residual, columns, (0, 4), title)


def show_evidence(evidence: "Evidence") -> Table:
    """Return the table of what is left of held-out stretches, joint by joint."""

    def write(value: float) -> str:
        return f"{value:.3g}" if math.isfinite(value) else ""

    parts = f"{evidence.logs} logs" if evidence.logs else f"{evidence.stretches} stretches"
    columns = (
        "joint; fit/%=fitted:.3g; held out/%=held_out:.3g; in motion/%=moving; at reversal/%=reversing; "
        "at rest/%=resting; rows left out/%=slow:.3g; torque rms=torque:.3g"
    )
    title = f"Residual below {evidence.scoring:.3g} Hz, relative to the torque; {parts} held out in turn."
    return tabulate(
        evidence.joints,
        columns,
        title=title,
        slow=lambda entry: 100.0 * entry.share,
        moving=lambda entry: write(entry.moving),
        reversing=lambda entry: write(entry.reversing),
        resting=lambda entry: write(entry.resting),
    )


def show_motion(motion: Sequence["MotionResidual"], title: str = "") -> tuple[Table, ...]:
    """Return the table of residuals in motion, at reversal and at rest; nothing of rows without phases."""
    if not motion:
        return ()

    def write_part(place: int) -> Callable[["MotionResidual"], str]:
        def write(entry: "MotionResidual") -> str:
            rms = entry.rms[place]
            return "" if rms is None else f"{rms:.4g} ({100.0 * entry.rows[place] / sum(entry.rows):.3g} %)"

        return write

    left_out = any(entry.left_out for entry in motion)
    columns = "joint; in motion=moving; at reversal=reversing; at rest=resting; unit"
    if left_out:
        columns += "; left out=missing; all rows=whole:.4g"
    table = tabulate(
        motion,
        columns,
        (0, 4),
        title or "RMS of the residual of all rows, and their share; at reversal: below 5 % of the top speed.",
        moving=write_part(0),
        reversing=write_part(1),
        resting=write_part(2),
        missing=lambda entry: entry.left_out or "",
    )
    return (table,)


def describe_motion(motion: "MotionResidual") -> str:
    """Return the residual of one joint in motion, at reversal and at rest in a sentence."""
    words = zip(("in motion", "at reversal", "at rest"), motion.rms, motion.rows, strict=True)
    parts = [
        f"{name} {rms:.4g} {motion.unit} ({100.0 * rows / sum(motion.rows):.3g} % of the rows)"
        for name, rms, rows in words
        if rms is not None
    ]
    text = ", ".join(parts)
    if motion.left_out:
        whole = f"{motion.whole:.4g} {motion.unit}"
        text += f"; {motion.left_out} of these rows were left out above, all of them have {whole}"
    return text


def describe_band(residual: "BandResidual") -> dict[str, object]:
    """Return the residual within a band as `symid validate --json` gives it."""
    joints = [
        {**entry, "range_percent": share}
        for entry, share in zip(describe_residual(residual.joints), residual.range_percent, strict=True)
    ]
    return {
        "frequency": residual.band,
        "residual": joints,
        "mean_relative_percent": residual.mean_relative_percent,
        "stacked_percent": residual.stacked_percent,
    }


def describe_band_metric(residual: "BandResidual") -> str:
    """Return how torques within a band are compared, and the residual of all joints as one vector."""
    text = (
        f"measured and predicted torque: both low-pass at {residual.band:g} Hz (Butterworth, order 4, zero "
        "phase), without 0.5 s at either end"
    )
    stacked = residual.stacked_percent
    return text if stacked is None else f"{text}; all joints as one vector: {stacked:.4f} %"


def show_band(residual: "BandResidual") -> Table:
    """Return the table of residuals within a band."""
    rows = [
        [entry.joint, entry.std, f"{entry.relative_percent:.4f}", f"{share:.4f}", entry.unit, entry.samples]
        for entry, share in zip(residual.joints, residual.range_percent, strict=True)
    ]
    header = ("joint", "rms", "relative/%", "of range/%", "unit", "samples")
    return Table(header, rows, left=(0, 4))


def describe_alignment(alignment: "Alignment", joints: Sequence[str]) -> dict[str, object]:
    """Return delay and offsets: one object a run, one entry a joint; null where they are not identifiable."""
    return {
        "delay_ms": 1e3 * alignment.delay,
        "delay_std_ms": 1e3 * alignment.delay_std,
        "joint_delays_ms": dict(zip(joints, (1e3 * alignment.delays).tolist(), strict=True)),
        "delay_explains": dict(zip(joints, alignment.explained.tolist(), strict=True)),
        "offsets": [
            {
                "log": source,
                "offsets": dict(zip(joints, values.tolist(), strict=True)),
                "std": dict(zip(joints, stds.tolist(), strict=True)),
            }
            for source, values, stds in zip(
                alignment.sources, alignment.offsets, alignment.offset_stds, strict=True
            )
        ],
    }


def describe_stiffness(found: "StiffnessEstimate") -> dict[str, object]:
    """Return the result as `symid identify --method stiffness --json` gives it."""
    return {
        "robot": found.robot,
        "method": "stiffness",
        **describe_alignment(found.alignment, [entry.joint for entry in found.joints]),
        "joints": [
            {
                "verdict": entry.verdict.name.lower(),
                "identified": entry.stiffness is not None,
                **select_fields(entry, "name=joint stiffness interval unit compliance compliance_std=std"),
                **select_fields(entry, "run_compliances=runs run_compliance_stds=run_stds"),
                **select_fields(entry, "torsion_explained=explained torsion_left=left reason"),
            }
            for entry in found.joints
        ],
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
    rows = [
        (entry.joint, source, values[index], stds[index], 100.0 * alignment.explained[index])
        for source, values, stds in zip(
            alignment.sources, alignment.offsets, alignment.offset_stds, strict=True
        )
        for index, entry in enumerate(found.joints)
        if alignment.present[index]
    ]
    table = tabulate(
        found.joints,
        "joint; stiffness; from=low; to (95 %)=high; unit; explained/1e-6=part; left/1e-6=gap; verdict=word",
        (0, 4, 7),
        low=lambda entry: entry.interval and entry.interval[0],
        high=lambda entry: entry.interval and entry.interval[1],
        part=lambda entry: 1e6 * entry.explained,
        gap=lambda entry: 1e6 * entry.left,
        word=lambda entry: entry.verdict.name.lower().replace("_", " "),
    )
    return (
        f"{found.robot}: the stiffness of {known} of {len(found.joints)} joints is identifiable",
        text,
        Table(("joint", "log", "zero offset", "std", "explained by delay/%"), rows, left=(0, 1)),
        table,
        "\n".join(f"{entry.joint}: {entry.reason}" for entry in found.joints),
    )


def describe_elastic(estimate: "ElasticEstimate") -> dict[str, object]:
    """Return the estimate of elastic joints as `symid identify --json` gives it."""
    return {
        **select_fields(estimate, "robot method reason"),
        "parameters": [
            {**asdict(entry), "relative_std_percent": entry.relative_std_percent}
            for entry in estimate.parameters
        ],
        "springs": [asdict(entry) for entry in estimate.springs],
        "effects": [_describe_effect(estimate, effect) for effect in estimate.effects],
        "evidence": None if estimate.evidence is None else asdict(estimate.evidence),
        "residual": describe_residual(estimate.residual),
        "energy": describe_residual((estimate.energy,))[0],
        "condition": estimate.condition,
        "outcome": describe_outcome(estimate.outcome),
        "history": [asdict(entry) for entry in estimate.history],
        "trials": [{**asdict(trial), "outcome": trial.outcome.name.lower()} for trial in estimate.trials],
        "refused": _describe_refused(estimate.refused),
        **select_fields(estimate, "sources settings signature"),
    }


def show_elastic(estimate: "ElasticEstimate") -> tuple[Block, ...]:
    """Return a headline, why the method was chosen, the tables, and what is not identifiable."""
    trials = tabulate(
        estimate.trials,
        "method; prediction error=error; choice; outcome=outcome.value",
        (0, 2, 3),
        choice=lambda trial: "chosen" if trial.method == estimate.method else "",
    )
    return (
        f"{estimate.robot}: {estimate.method}, condition {estimate.condition:.3g}: {estimate.outcome.value}",
        f"{estimate.reason[:1].upper()}{estimate.reason[1:]}.",
        show_elastic_parameters(estimate),
        *([show_springs(estimate)] if estimate.springs else []),
        *([show_effects(estimate)] if estimate.effects else []),
        show_residual((*estimate.residual, estimate.energy)),
        *([trials] if len(estimate.trials) > 1 else []),
        *(f"refused: {name}: {reason}" for name, reason in estimate.refused),
    )


def show_elastic_parameters(estimate: "ElasticEstimate") -> Table:
    """Return the table of dynamic parameters, with the truth beside them where it is known."""
    return _tabulate_parameters(estimate.parameters, "; unit", "; true=truth; error/%=error_percent")


def show_springs(estimate: "ElasticEstimate") -> Table:
    """Return the table of springs: stiffness left and at small torsion, and how far they were excited."""
    from symid.joint_models import find_most_slope

    told = [entry for entry in estimate.springs if entry.told]
    if any(entry.elasticity.branches for entry in told):
        return tabulate(
            told,
            "joint; k0=elasticity.stiffness; at most=steepest; slope std=slope_std; unit; branches; torsion; "
            "torque; torque std=torque_std",
            (0, 4, 5),
            steepest=lambda entry: find_most_slope(entry.elasticity),
            unit=lambda entry: f"{entry.torque_unit}/{entry.position_unit}",
            branches=_name_branches,
        )
    return tabulate(
        told,
        "joint; k0=elasticity.stiffness; k0 + stops=elasticity.initial_stiffness; slope std=slope_std; unit; "
        "stops; knees; torsion; slipped to=excited; torque; torque std=torque_std",
        (0, 4),
        unit=lambda entry: f"{entry.torque_unit}/{entry.position_unit}",
        stops=lambda entry: len(entry.elasticity.stops),
        knees=lambda entry: len(entry.elasticity.knees),
    )


def _name_branches(entry: "SpringEstimate") -> str:
    names = [branch.kind for branch in entry.elasticity.branches]
    counts = ((len(entry.elasticity.stops), "stops"), (len(entry.elasticity.knees), "knees"))
    return ", ".join([*names, *(f"{count} {name}" for count, name in counts if count)]) or "linear"


_EFFECTS = {
    "torque-lag": "torque acts late",
    "link-friction": "viscous friction of the link",
    "torque-ripple": "torque ripple",
    "kinematic-error": "kinematic error of the gear",
    "link-eccentricity": "eccentricity of the link's encoder",
    "torsion-offset": "zero of the torsion",
}


def _describe_effect(estimate: "ElasticEstimate", effect: "DriveEffect") -> dict[str, object]:
    """Return an effect in plain types, with its joint and unit."""
    torque = estimate.residual[max(effect.joint, 0)].unit
    position = "m" if torque == "N" else "rad"
    units = {
        "torque-lag": "s",
        "link-friction": f"{torque} s/{position}",
        "torque-ripple": torque,
        "kinematic-error": position,
        "link-eccentricity": position,
        "torsion-offset": position,
    }
    joint = "all" if effect.joint < 0 else estimate.residual[effect.joint].joint
    return {**asdict(effect), "joint": joint, "unit": units[effect.kind]}


def show_effects(estimate: "ElasticEstimate") -> Table:
    """Return the table of what drives, gears and links add: amplitudes of waves, and their order."""
    rows = []
    for effect in estimate.effects:
        plain = _describe_effect(estimate, effect)
        size = math.hypot(*effect.values)
        order = f"{effect.order:.6g}" if effect.order else ""
        values = (f"{size if effect.order else effect.values[0]:.4g}", f"{effect.deviations[0]:.2g}")
        rows.append((plain["joint"], _EFFECTS[effect.kind], order, *values, plain["unit"]))
    title = "Taken off before the fit; an order N is of waves cos(N theta), theta on the joint side."
    return Table(("joint", "effect", "order", "value", "std", "unit"), rows, (0, 1, 5), title)


_WIDTH = 100
_SHOWN = 3


def describe_friction(found: "FrictionIdentification") -> dict[str, object]:
    """Return the result as `symid identify --rows friction --json` gives it."""
    return {
        **select_fields(found, "robot model estimator sources settings signature"),
        "rows": "friction",
        "joints": [_describe_joint_friction(entry) for entry in found.joints],
        "refused": _describe_refused(found.refused, "joint"),
    }


def _describe_joint_friction(entry: "JointFriction") -> dict[str, object]:
    estimate, selection, poses = entry.estimate, entry.selection, entry.poses
    parameter = f"{_PARAMETER} meaning=expression remark=reason"
    pose_fields = "name unit values std=stds interval_95=intervals chance degrees_of_freedom=freedom"
    figures = "objective sigma aicc bic condition evaluations solves iterations ended"
    return {
        **select_fields(entry, "joint formula smoothing sources"),
        **select_fields(estimate, f"law estimator {figures}"),
        "parameters": [select_fields(value, parameter) for value in estimate.parameters],
        "rigid": {
            "text": entry.rigid,
            "parameters": [select_fields(value, parameter) for value in estimate.extra],
        },
        "refused": _describe_refused(estimate.refused),
        "residual": describe_residual((entry.residual,))[0],
        "motion": None if entry.motion is None else describe_motion_parts(entry.motion),
        "outcome": describe_outcome(estimate.outcome),
        "selection": selection
        and {
            **select_fields(selection, "chosen verdict blocks"),
            "trials": [select_fields(trial, _TRIAL) for trial in selection.trials],
        },
        "poses": poses
        and {
            **select_fields(poses, "law verdict differs change"),
            "poses": [{"others": dict(pose.others), "sources": pose.sources} for pose in poses.poses],
            "skipped": _describe_refused(poses.skipped, "sources"),
            "parameters": [select_fields(line, pose_fields) for line in poses.parameters],
        },
        "map": select_fields(entry.velocity_map, "velocity torque spread rows=count"),
    }


def show_friction(found: "FrictionIdentification") -> tuple[Block, ...]:
    """Return all that is found of a robot, joint by joint, and why it is not of the others."""
    size = len(found.joints) + len(found.refused)
    head = f"{found.robot}: friction of {len(found.joints)} of {size} joint{'s'[: size > 1]}"
    refused = "\n".join(_wrap(f"{name}: {reason}") for name, reason in found.refused)
    joints = (block for entry in found.joints for block in _show_joint_friction(entry))
    return (head, *joints, *((refused,) if refused else ()))


def _show_joint_friction(entry: "JointFriction") -> tuple[Block, ...]:
    estimate, residual = entry.estimate, entry.residual
    parts: list[Block] = [f"== {entry.joint}: {estimate.law}, {estimate.estimator} =="]
    if entry.selection is not None:
        parts += [show_law_trials(entry.selection), _wrap(entry.selection.verdict)]
    parts.append(f"{_wrap(entry.formula)}\n{_wrap(f'{estimate.outcome.value}; {estimate.ended}')}")
    # Beyond J, a and b they are groups whose values say nothing by themselves.
    rigid = estimate.extra if len(estimate.extra) <= _SHOWN else ()
    shown = (*estimate.parameters, *rigid)
    table = tabulate(
        shown,
        "parameter=name; value; std; std/%=relative_std_percent:.3g; unit; meaning",
        (0, 4, 5),
        meaning=lambda line: "rigid part" if line in rigid else line.reason or line.expression,
    )
    parts += [
        table if shown else "no parameter is identifiable",
        _wrap(
            f"{entry.rigid}; residual {residual.relative_percent:.4f} % of the torque, {residual.std:.4g} "
            f"{residual.unit} RMS over {residual.samples} rows"
        ),
    ]
    if entry.motion is not None:
        parts.append(_wrap(f"RMS {describe_motion(entry.motion)}"))
    if entry.poses is not None:
        parts += [*show_poses(entry.poses), _wrap(f"{entry.poses.verdict}.")]
    if estimate.refused:
        parts.append("\n".join(_wrap(f"refused: {name}: {reason}") for name, reason in estimate.refused))
    return tuple(parts)


def show_law_trials(selection: "LawSelection", title: str = "") -> Table:
    """Return the table of the laws that were compared, by torques held back."""
    return tabulate(
        selection.trials,
        "law; unknowns; fitted/%=fitted_percent:.4f; held out/%=held_percent:.4f; RMS=held_rms; "
        "squares=ratio:.4f; behind/se=behind:.1f; choice",
        (0, 7),
        title,
        choice=lambda trial: "chosen" if trial.law == selection.chosen else trial.reason,
    )


def show_poses(poses: "PoseTest") -> tuple[Block, ...]:
    """Return the intervals of every parameter pose by pose, and where the poses are."""
    header = ("parameter", *(f"pose {k}, 95 %" for k in range(1, len(poses.poses) + 1)), "unit", "chance")
    rows = [
        (
            entry.name,
            *(f"{low:.4g} .. {high:.4g}" for low, high in entry.intervals),
            *(entry.unit, f"{entry.chance:.2g}"),
        )
        for entry in poses.parameters
    ]
    lines = []
    for number, pose in enumerate(poses.poses, start=1):
        others = ", ".join(f"{name} {place:.3g}" for name, place in pose.others)
        lines.append(f"pose {number}: {others} ({', '.join(pose.sources)})")
    lines += [_wrap(f"left out: {sources}: {reason}") for sources, reason in poses.skipped]
    text = "\n".join(lines)
    return (Table(header, rows, left=(0, len(poses.poses) + 1), title=text) if rows else text,)


def _wrap(text: str) -> str:
    return textwrap.fill(text, width=_WIDTH)
