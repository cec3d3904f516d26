"""Results of friction, as tables for people and as objects for programs.

Input: `FrictionIdentification`. Output: text, dictionaries.
"""

import textwrap
from typing import TYPE_CHECKING

from symid.report.blocks import Block, Table, format_table
from symid.report.estimate_text import describe_residual

if TYPE_CHECKING:  # these load numpy
    from symid.estimators.estimate import ParameterEstimate
    from symid.friction.poses import PoseTest
    from symid.friction.results import FrictionIdentification, JointFriction
    from symid.friction.selection import LawSelection

__all__ = ["describe_friction", "show_friction"]

_WIDTH = 100
_SHOWN = 3


def describe_friction(found: "FrictionIdentification") -> dict[str, object]:
    """Return the result as `symid identify --rows friction --json` gives it."""
    return {
        "robot": found.robot,
        "rows": "friction",
        "model": found.model,
        "estimator": found.estimator,
        "joints": [_describe_joint(entry) for entry in found.joints],
        "refused": [{"joint": name, "reason": reason} for name, reason in found.refused],
        "sources": found.sources,
        "settings": found.settings,
        "signature": found.signature,
    }


def _describe_joint(entry: "JointFriction") -> dict[str, object]:
    estimate = entry.estimate
    return {
        "joint": entry.joint,
        "law": estimate.law,
        "formula": entry.formula,
        "smoothing": entry.smoothing,
        "estimator": estimate.estimator,
        "parameters": [_describe_parameter(parameter) for parameter in estimate.parameters],
        "rigid": {"text": entry.rigid, "parameters": list(map(_describe_parameter, estimate.extra))},
        "refused": [{"name": name, "reason": reason} for name, reason in estimate.refused],
        "residual": describe_residual((entry.residual,))[0],
        "objective": estimate.objective,
        "sigma": estimate.sigma,
        "aicc": estimate.aicc,
        "bic": estimate.bic,
        "condition": estimate.condition,
        "evaluations": estimate.evaluations,
        "solves": estimate.solves,
        "iterations": estimate.iterations,
        "outcome": {"name": estimate.outcome.name.lower(), "text": estimate.outcome.value},
        "ended": estimate.ended,
        "selection": None if entry.selection is None else _describe_selection(entry.selection),
        "poses": None if entry.poses is None else _describe_poses(entry.poses),
        "map": {
            "velocity": entry.velocity_map.velocity.tolist(),
            "torque": entry.velocity_map.torque.tolist(),
            "spread": entry.velocity_map.spread.tolist(),
            "rows": entry.velocity_map.count.tolist(),
        },
        "sources": entry.sources,
    }


def _describe_parameter(entry: "ParameterEstimate") -> dict[str, object]:
    return {
        "name": entry.name,
        "value": entry.value,
        "std": entry.std,
        "relative_std_percent": entry.relative_std_percent,
        "unit": entry.unit,
        "meaning": entry.expression,
        "remark": entry.reason,
    }


def _describe_selection(selection: "LawSelection") -> dict[str, object]:
    return {
        "chosen": selection.chosen,
        "verdict": selection.verdict,
        "blocks": selection.blocks,
        "trials": [
            {
                "law": trial.law,
                "unknowns": trial.unknowns,
                "fitted_percent": trial.fitted_percent,
                "held_percent": trial.held_percent,
                "held_rms": trial.held_rms,
                "squared_error_ratio": trial.ratio,
                "standard_errors_behind": trial.behind,
                "aicc": trial.aicc,
                "reason": trial.reason,
            }
            for trial in selection.trials
        ],
    }


def _describe_poses(poses: "PoseTest") -> dict[str, object]:
    return {
        "law": poses.law,
        "verdict": poses.verdict,
        "differs": poses.differs,
        "change": poses.change,
        "poses": [{"others": dict(pose.others), "sources": pose.sources} for pose in poses.poses],
        "skipped": [{"sources": sources, "reason": reason} for sources, reason in poses.skipped],
        "parameters": [
            {
                "name": entry.name,
                "unit": entry.unit,
                "values": entry.values,
                "std": entry.stds,
                "interval_95": [list(interval) for interval in entry.intervals],
                "chance": entry.chance,
                "degrees_of_freedom": entry.freedom,
            }
            for entry in poses.parameters
        ],
    }


def show_friction(found: "FrictionIdentification") -> tuple[Block, ...]:
    """Return all that is found of a robot, joint by joint, and why it is not of the others."""
    size = len(found.joints) + len(found.refused)
    head = f"{found.robot}: friction of {len(found.joints)} of {size} joint{'s'[: size > 1]}"
    refused = "\n".join(_wrap(f"{name}: {reason}") for name, reason in found.refused)
    joints = (block for entry in found.joints for block in _show_joint(entry))
    return (head, *joints, *((refused,) if refused else ()))


def _show_joint(entry: "JointFriction") -> tuple[Block, ...]:
    """Return all that is found of a joint: choice, law, parameters, residual, poses, what was refused."""
    estimate = entry.estimate
    head = f"== {entry.joint}: {estimate.law}, {estimate.estimator} =="
    parts: list[Block] = [head]
    if entry.selection is not None:
        parts += [_show_trials(entry.selection), _wrap(entry.selection.verdict)]
    parts.append(f"{_wrap(entry.formula)}\n{_wrap(f'{estimate.outcome.value}; {estimate.ended}')}")
    parts.append(_show_parameters(entry))
    residual = entry.residual
    parts.append(
        _wrap(
            f"{entry.rigid}; residual {residual.relative_percent:.4f} % of the torque, {residual.std:.4g} "
            f"{residual.unit} RMS over {residual.samples} rows"
        )
    )
    if entry.poses is not None:
        parts += [*_show_poses(entry.poses), _wrap(f"{entry.poses.verdict}.")]
    if estimate.refused:
        parts.append("\n".join(_wrap(f"refused: {name}: {reason}") for name, reason in estimate.refused))
    return tuple(parts)


def _show_trials(selection: "LawSelection") -> Table:
    header = ("law", "unknowns", "fitted/%", "held back/%", "RMS", "squares", "behind/se", "")
    rows = [
        [
            trial.law,
            trial.unknowns,
            _write(trial.fitted_percent, ".4f"),
            _write(trial.held_percent, ".4f"),
            trial.held_rms,
            _write(trial.ratio, ".4f"),
            _write(trial.behind, ".1f"),
            "taken" if trial.law == selection.chosen else trial.reason,
        ]
        for trial in selection.trials
    ]
    return format_table(header, rows, left=(0, 7))


def _write(value: float | None, form: str) -> str:
    return "" if value is None else format(value, form)


def _show_parameters(entry: "JointFriction") -> Block:
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
    return format_table(header, rows, left=(0, 4, 5)) if rows else "no parameter can be told"


def _show_poses(poses: "PoseTest") -> tuple[Block, ...]:
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
    return (format_table(header, rows, left=(0, len(poses.poses) + 1), title=text),)


def _wrap(text: str) -> str:
    return textwrap.fill(text, width=_WIDTH)
