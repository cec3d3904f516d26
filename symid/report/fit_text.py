"""Results of an identification, as tables for people and as objects for programs.

`Estimate`, `Validation`, `ElasticEstimate`, `Alignment`, `StiffnessEstimate`, `FrictionIdentification`
-> blocks, dictionaries.
"""

import math
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from symid.report.blocks import Block, Table, describe_outcome, select_fields

if TYPE_CHECKING:
    from symid.identification.diagnostics import BandResidual
    from symid.identification.elastic import ElasticEstimate, StiffnessEstimate
    from symid.identification.estimators import Estimate, Residual, Validation
    from symid.identification.friction import FrictionIdentification, JointFriction, LawSelection, PoseTest
    from symid.logs import Alignment


_PARAMETER = "name value std relative_std_percent unit"


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
    }


def _describe_refused(refused: "Sequence[tuple[str, str]]", key: str = "name") -> list[dict[str, str]]:
    return [{key: name, "reason": reason} for name, reason in refused]


def describe_validation(validation: "Validation") -> dict[str, object]:
    """Return the validation as `symid validate --json` gives it."""
    return {
        **select_fields(validation, "robot log=source rows samples mean_relative_percent"),
        "residual": describe_residual(validation.residual),
    }


def describe_residual(residual: Sequence["Residual"]) -> list[dict[str, object]]:
    """Return one object a joint."""
    return [select_fields(entry, "joint norm relative_percent std samples unit") for entry in residual]


def show_estimate(estimate: "Estimate") -> tuple[Block, ...]:
    """Return a headline, the tables, how a simulation went, and what was refused."""
    headline = (
        f"{estimate.robot}: {estimate.rows} rows, {estimate.estimator}, {estimate.samples} equations, "
        f"condition {estimate.condition:.3g}: {estimate.outcome.value}"
    )
    blocks = (headline, show_parameters(estimate), show_residual(estimate.residual))
    refused = "\n".join(f"refused: {name}: {reason}" for name, reason in estimate.refused)
    return (*blocks, *_show_tracking(estimate), *((refused,) if refused else ()))


def _show_tracking(estimate: "Estimate") -> tuple[str, ...]:
    """Return what an estimator that simulates the robot says of its simulations, nothing of others."""
    told: Any = estimate.settings.get("fit")
    if not isinstance(told, Mapping) or "tracking" not in told:
        return ()
    count = told["iterations"]
    lines = [f"begun with {told['start']}; {count} simulation{'s'[: count > 1]} of the controlled robot"]
    lines += [
        f"{entry['joint']}: simulated positions {entry['simulated_from_measured']:.3g} {entry['unit']} (rms) "
        f"from the measured ones, the reference {entry['reference_from_measured']:.3g} {entry['unit']}"
        for entry in told["tracking"]
    ]
    if "wls" in told:
        lines.append(told["wls"]["verdict"])
    return ("\n".join(lines),)


def show_parameters(estimate: "Estimate") -> Table:
    """Return the table of parameters, with the robot file's values beside them where it states them."""
    known = any(entry.truth is not None for entry in estimate.parameters)
    header = ["parameter", "value", "std", "std/%", "unit"]
    rows: list[list[object]] = [
        [entry.name, entry.value, entry.std, f"{entry.relative_std_percent:.3g}", entry.unit]
        for entry in estimate.parameters
    ]
    if known:
        header += ["robot file", "within 3 std"]
        for row, entry in zip(rows, estimate.parameters, strict=True):
            row += [entry.truth, entry.near_truth]
    return Table(header, rows, left=(0, 4))


def show_residual(residual: Sequence["Residual"], title: str = "") -> Table:
    """Return the table of residuals."""
    rows = [
        [entry.joint, entry.norm, f"{entry.relative_percent:.4f}", entry.std, entry.unit, entry.samples]
        for entry in residual
    ]
    return Table(("joint", "norm", "relative/%", "std", "unit", "samples"), rows, (0, 4), title)


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
    }


def show_band(residual: "BandResidual") -> Table:
    """Return the table of residuals within a band."""
    rows = [
        [entry.joint, entry.std, f"{entry.relative_percent:.4f}", f"{share:.4f}", entry.unit, entry.samples]
        for entry, share in zip(residual.joints, residual.range_percent, strict=True)
    ]
    header = ("joint", "rms", "relative/%", "of range/%", "unit", "samples")
    return Table(header, rows, left=(0, 4))


def describe_alignment(alignment: "Alignment", joints: Sequence[str]) -> dict[str, object]:
    """Return delay and offsets: one object a run, one entry a joint; null where they cannot be told."""
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


def show_alignment(alignment: "Alignment", joints: Sequence[str]) -> tuple[Block, ...]:
    """Return the delay, and the table of zero offsets of each run and joint that has a link encoder."""
    rows = [
        (
            joint,
            source,
            _none_if_unknown(values[index]),
            _none_if_unknown(stds[index]),
            100.0 * alignment.explained[index],
        )
        for source, values, stds in zip(
            alignment.sources, alignment.offsets.tolist(), alignment.offset_stds.tolist(), strict=True
        )
        for index, joint in enumerate(joints)
        if alignment.present[index]
    ]
    header = ("joint", "log", "zero offset", "std", "explained by delay/%")
    return (_describe_delay(alignment), Table(header, rows, left=(0, 1)))


def _describe_delay(alignment: "Alignment") -> str:
    std = 1e3 * alignment.delay_std
    if not alignment.late:
        text = "between link and motor encoders there is no delay beyond doubt"
        return f"{text} (standard deviation {std:.2g} ms)"
    verb = "lag" if alignment.delay > 0.0 else "lead"
    delay = 1e3 * abs(alignment.delay)
    return f"link encoders {verb} motor encoders by {delay:.3f} ms (standard deviation {std:.3f} ms)"


def _none_if_unknown(value: float) -> float | None:
    """Return what a table shows of a value that may not be known."""
    return value if math.isfinite(value) else None


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
    """Return how many joints have one, delay and offsets, the table of stiffnesses, and the reasons."""
    told = sum(entry.stiffness is not None for entry in found.joints)
    return (
        f"{found.robot}: the stiffness of {told} of {len(found.joints)} joints can be told",
        *show_alignment(found.alignment, [entry.joint for entry in found.joints]),
        _tabulate_stiffness(found),
        "\n".join(f"{entry.joint}: {entry.reason}" for entry in found.joints),
    )


def _tabulate_stiffness(found: "StiffnessEstimate") -> Table:
    rows = [
        [
            entry.joint,
            entry.stiffness,
            *(entry.interval or (None, None)),
            entry.unit,
            None if entry.explained != entry.explained else 1e6 * entry.explained,
            None if entry.left != entry.left else 1e6 * entry.left,
            entry.verdict.name.lower().replace("_", " "),
        ]
        for entry in found.joints
    ]
    header = ("joint", "stiffness", "from", "to (95 %)", "unit", "explained/1e-6", "left/1e-6", "verdict")
    return Table(header, rows, left=(0, 4, 7))


def describe_elastic(estimate: "ElasticEstimate") -> dict[str, object]:
    """Return the estimate of elastic joints as `symid identify --json` gives it."""
    return {
        **select_fields(estimate, "robot method reason"),
        "parameters": [
            {**asdict(entry), "relative_std_percent": entry.relative_std_percent}
            for entry in estimate.parameters
        ],
        "springs": [asdict(entry) for entry in estimate.springs],
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
    """Return a headline, why the method was taken, the tables, and what was refused."""
    return (
        f"{estimate.robot}: {estimate.method}, condition {estimate.condition:.3g}: {estimate.outcome.value}",
        f"{estimate.reason[:1].upper()}{estimate.reason[1:]}.",
        show_elastic_parameters(estimate),
        *([show_springs(estimate)] if estimate.springs else []),
        show_residual((*estimate.residual, estimate.energy)),
        *([show_trials(estimate)] if len(estimate.trials) > 1 else []),
        *(f"refused: {name}: {reason}" for name, reason in estimate.refused),
    )


def show_elastic_parameters(estimate: "ElasticEstimate") -> Table:
    """Return the table of dynamic parameters, with the truth beside them where it is known."""
    known = any(entry.truth is not None for entry in estimate.parameters)
    header = ("parameter", "value", "std", "std/%", "unit", *(("true", "error/%") if known else ()))
    rows: list[list[object]] = []
    for entry in estimate.parameters:
        row: list[object] = [entry.name, entry.value, entry.std, entry.relative_std_percent, entry.unit]
        if known:
            row += [entry.truth, entry.error_percent]
        rows.append(row)
    return Table(header, rows, left=(0, 4))


def show_springs(estimate: "ElasticEstimate") -> Table:
    """Return the table of springs found: stiffness left and at small torsion, and what was seen of it."""
    header = ("joint", "k0", "k0 + stops", "unit", "stops", "knees", "torsion", "slipped to", "torque")
    rows = [
        (
            entry.joint,
            entry.elasticity.stiffness,
            _add_stops(entry.elasticity.stiffness, [stop.stiffness for stop in entry.elasticity.stops]),
            f"{entry.torque_unit}/{entry.position_unit}",
            len(entry.elasticity.stops),
            len(entry.elasticity.knees),
            entry.torsion,
            entry.excited,
            entry.torque,
        )
        for entry in estimate.springs
        if entry.told
    ]
    return Table(header, rows, left=(0, 3))


def _add_stops(stiffness: float | None, stops: Sequence[float | None]) -> float | None:
    return None if stiffness is None else stiffness + sum(value or 0.0 for value in stops)


def show_trials(estimate: "ElasticEstimate") -> Table:
    """Return the table of the methods that were compared."""
    rows = [
        (trial.method, trial.error, "chosen" if trial.method == estimate.method else "", trial.outcome.value)
        for trial in estimate.trials
    ]
    return Table(("method", "error of prediction", "", "outcome"), rows, left=(0, 2, 3))


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
    estimate = entry.estimate
    parameter = f"{_PARAMETER} meaning=expression remark=reason"
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
        "outcome": describe_outcome(estimate.outcome),
        "selection": None if entry.selection is None else _describe_selection(entry.selection),
        "poses": None if entry.poses is None else _describe_poses(entry.poses),
        "map": select_fields(entry.velocity_map, "velocity torque spread rows=count"),
    }


def _describe_selection(selection: "LawSelection") -> dict[str, object]:
    errors = "fitted_percent held_percent held_rms squared_error_ratio=ratio standard_errors_behind=behind"
    return {
        **select_fields(selection, "chosen verdict blocks"),
        "trials": [select_fields(trial, f"law unknowns {errors} aicc reason") for trial in selection.trials],
    }


def _describe_poses(poses: "PoseTest") -> dict[str, object]:
    parameter = "name unit values std=stds interval_95=intervals chance degrees_of_freedom=freedom"
    return {
        **select_fields(poses, "law verdict differs change"),
        "poses": [{"others": dict(pose.others), "sources": pose.sources} for pose in poses.poses],
        "skipped": _describe_refused(poses.skipped, "sources"),
        "parameters": [select_fields(entry, parameter) for entry in poses.parameters],
    }


def show_friction(found: "FrictionIdentification") -> tuple[Block, ...]:
    """Return all that is found of a robot, joint by joint, and why it is not of the others."""
    size = len(found.joints) + len(found.refused)
    head = f"{found.robot}: friction of {len(found.joints)} of {size} joint{'s'[: size > 1]}"
    refused = "\n".join(_wrap(f"{name}: {reason}") for name, reason in found.refused)
    joints = (block for entry in found.joints for block in _show_joint_friction(entry))
    return (head, *joints, *((refused,) if refused else ()))


def _show_joint_friction(entry: "JointFriction") -> tuple[Block, ...]:
    """Return all that is found of a joint: choice, law, parameters, residual, poses, what was refused."""
    estimate = entry.estimate
    head = f"== {entry.joint}: {estimate.law}, {estimate.estimator} =="
    parts: list[Block] = [head]
    if entry.selection is not None:
        parts += [show_law_trials(entry.selection), _wrap(entry.selection.verdict)]
    parts.append(f"{_wrap(entry.formula)}\n{_wrap(f'{estimate.outcome.value}; {estimate.ended}')}")
    parts.append(_show_law_parameters(entry))
    residual = entry.residual
    parts.append(
        _wrap(
            f"{entry.rigid}; residual {residual.relative_percent:.4f} % of the torque, {residual.std:.4g} "
            f"{residual.unit} RMS over {residual.samples} rows"
        )
    )
    if entry.poses is not None:
        parts += [*show_poses(entry.poses), _wrap(f"{entry.poses.verdict}.")]
    if estimate.refused:
        parts.append("\n".join(_wrap(f"refused: {name}: {reason}") for name, reason in estimate.refused))
    return tuple(parts)


def show_law_trials(selection: "LawSelection", title: str = "") -> Table:
    """Return the table of the laws that were compared, by torques held back."""
    header = ("law", "unknowns", "fitted/%", "held back/%", "RMS", "squares", "behind/se", "")
    rows = [
        [
            trial.law,
            trial.unknowns,
            _format_number(trial.fitted_percent, ".4f"),
            _format_number(trial.held_percent, ".4f"),
            trial.held_rms,
            _format_number(trial.ratio, ".4f"),
            _format_number(trial.behind, ".1f"),
            "taken" if trial.law == selection.chosen else trial.reason,
        ]
        for trial in selection.trials
    ]
    return Table(header, rows, (0, 7), title)


def _format_number(value: float | None, form: str) -> str:
    return "" if value is None else format(value, form)


def _show_law_parameters(entry: "JointFriction") -> Block:
    estimate = entry.estimate
    header = ("parameter", "value", "std", "std/%", "unit", "")
    rows: list[list[object]] = []
    # Beyond J, a and b they are groups whose values say nothing by themselves.
    rigid = estimate.extra if len(estimate.extra) <= _SHOWN else ()
    for kind, parameters in (("", estimate.parameters), ("rigid part", rigid)):
        rows += [
            [
                parameter.name,
                parameter.value,
                parameter.std,
                f"{parameter.relative_std_percent:.3g}",
                parameter.unit,
                kind or parameter.reason or parameter.expression,
            ]
            for parameter in parameters
        ]
    return Table(header, rows, left=(0, 4, 5)) if rows else "no parameter can be told"


def show_poses(poses: "PoseTest") -> tuple[Block, ...]:
    """Return the intervals of every parameter pose by pose, and where the poses are."""
    header = ("parameter", *(f"pose {k}, 95 %" for k in range(1, len(poses.poses) + 1)), "unit", "chance")
    rows = [
        [
            entry.name,
            *(f"{low:.4g} .. {high:.4g}" for low, high in entry.intervals),
            entry.unit,
            f"{entry.chance:.2g}",
        ]
        for entry in poses.parameters
    ]
    places = [
        f"pose {k}: "
        + ", ".join(f"{name} {place:.3g}" for name, place in pose.others)
        + f" ({', '.join(pose.sources)})"
        for k, pose in enumerate(poses.poses, start=1)
    ]
    places += [_wrap(f"left out: {sources}: {reason}") for sources, reason in poses.skipped]
    text = "\n".join(places)
    if not rows:
        return (text,)
    return (Table(header, rows, left=(0, len(poses.poses) + 1), title=text),)


def _wrap(text: str) -> str:
    return textwrap.fill(text, width=_WIDTH)
