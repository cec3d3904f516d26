"""Results on elastic joints, as tables for people and as objects for programs.

Input: `Alignment`, `StiffnessEstimate`, `ElasticEstimate`. Output: text, dictionaries.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

from symid.report.blocks import Block, Table, format_table
from symid.report.estimate_text import describe_residual, show_residual

if TYPE_CHECKING:  # these load numpy
    from symid.data.alignment import Alignment
    from symid.elastic.estimate import ElasticEstimate
    from symid.elastic.stiffness import StiffnessEstimate

__all__ = [
    "describe_alignment",
    "describe_elastic",
    "describe_stiffness",
    "show_alignment",
    "show_elastic",
    "show_elastic_parameters",
    "show_springs",
    "show_stiffness",
    "show_trials",
]


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
        (joint, source, _null(values[index]), _null(stds[index]), 100.0 * alignment.explained[index])
        for source, values, stds in zip(
            alignment.sources, alignment.offsets.tolist(), alignment.offset_stds.tolist(), strict=True
        )
        for index, joint in enumerate(joints)
        if alignment.present[index]
    ]
    header = ("joint", "log", "zero offset", "std", "explained by delay/%")
    return (_tell_delay(alignment), format_table(header, rows, left=(0, 1)))


def _tell_delay(alignment: "Alignment") -> str:
    std = 1e3 * alignment.delay_std
    if not alignment.late:
        text = "between link and motor encoders there is no delay beyond doubt"
        return f"{text} (standard deviation {std:.2g} ms)"
    verb = "lag" if alignment.delay > 0.0 else "lead"
    delay = 1e3 * abs(alignment.delay)
    return f"link encoders {verb} motor encoders by {delay:.3f} ms (standard deviation {std:.3f} ms)"


def _null(value: float) -> float | None:
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
                "name": entry.joint,
                "verdict": entry.verdict.name.lower(),
                "identified": entry.stiffness is not None,
                "stiffness": entry.stiffness,
                "interval": entry.interval,
                "unit": entry.unit,
                "compliance": entry.compliance,
                "compliance_std": entry.std,
                "run_compliances": entry.runs.tolist(),
                "run_compliance_stds": entry.run_stds.tolist(),
                "torsion_explained": entry.explained,
                "torsion_left": entry.left,
                "reason": entry.reason,
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
        _show_joints(found),
        "\n".join(f"{entry.joint}: {entry.reason}" for entry in found.joints),
    )


def _show_joints(found: "StiffnessEstimate") -> Table:
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
    return format_table(header, rows, left=(0, 4, 7))


def describe_elastic(estimate: "ElasticEstimate") -> dict[str, object]:
    """Return the estimate of elastic joints as `symid identify --json` gives it."""
    return {
        "robot": estimate.robot,
        "method": estimate.method,
        "reason": estimate.reason,
        "parameters": [
            {**asdict(entry), "relative_std_percent": entry.relative_std_percent}
            for entry in estimate.parameters
        ],
        "springs": [asdict(entry) for entry in estimate.springs],
        "residual": describe_residual(estimate.residual),
        "energy": describe_residual((estimate.energy,))[0],
        "condition": estimate.condition,
        "outcome": {"name": estimate.outcome.name.lower(), "text": estimate.outcome.value},
        "history": [asdict(entry) for entry in estimate.history],
        "trials": [{**asdict(trial), "outcome": trial.outcome.name.lower()} for trial in estimate.trials],
        "refused": [{"name": name, "reason": reason} for name, reason in estimate.refused],
        "sources": estimate.sources,
        "settings": estimate.settings,
        "signature": estimate.signature,
    }


def show_elastic(estimate: "ElasticEstimate") -> tuple[Block, ...]:
    """Return a headline, why the method was taken, the tables, and what was refused."""
    return (
        f"{estimate.robot}: {estimate.method}, condition {estimate.condition:.3g}: {estimate.outcome.value}",
        f"{estimate.reason[0].upper()}{estimate.reason[1:]}.",
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
            error = 100.0 * (entry.value - entry.truth) / abs(entry.truth) if entry.truth else None
            row += [entry.truth, error]
        rows.append(row)
    return format_table(header, rows, left=(0, 4))


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
    return format_table(header, rows, left=(0, 3))


def _add_stops(stiffness: float | None, stops: Sequence[float | None]) -> float | None:
    return None if stiffness is None else stiffness + sum(value or 0.0 for value in stops)


def show_trials(estimate: "ElasticEstimate") -> Table:
    """Return the table of the methods that were compared."""
    rows = [
        (trial.method, trial.error, "chosen" if trial.method == estimate.method else "", trial.outcome.value)
        for trial in estimate.trials
    ]
    return format_table(("method", "error of prediction", "", "outcome"), rows, left=(0, 2, 3))
