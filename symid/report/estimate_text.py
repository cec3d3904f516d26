"""Results of identification and validation, as tables for people and as objects for programs.

Input: `Estimate`, `Validation`. Output: text, dictionaries.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from symid.report.blocks import Block, Table, format_table

if TYPE_CHECKING:  # these load numpy
    from symid.estimators.estimate import Estimate, Residual, Validation
    from symid.residuals.metric import BandResidual

__all__ = [
    "describe_band",
    "describe_estimate",
    "describe_residual",
    "describe_validation",
    "show_band",
    "show_estimate",
    "show_parameters",
    "show_residual",
]


def describe_estimate(estimate: "Estimate") -> dict[str, object]:
    """Return the estimate as `symid identify --json` gives it."""
    return {
        "robot": estimate.robot,
        "rows": estimate.rows,
        "estimator": estimate.estimator,
        "friction": estimate.friction,
        "parameters": [
            {
                "name": entry.name,
                "value": entry.value,
                "std": entry.std,
                "relative_std_percent": entry.relative_std_percent,
                "unit": entry.unit,
                "expression": entry.expression,
                "truth": entry.truth,
            }
            for entry in estimate.parameters
        ],
        "residual": describe_residual(estimate.residual),
        "mean_relative_percent": estimate.mean_relative_percent,
        "condition": estimate.condition,
        "outcome": {"name": estimate.outcome.name.lower(), "text": estimate.outcome.value},
        "refused": [{"name": name, "reason": reason} for name, reason in estimate.refused],
        "samples": estimate.samples,
        "sources": estimate.sources,
        "settings": estimate.settings,
        "signature": estimate.signature,
    }


def describe_validation(validation: "Validation") -> dict[str, object]:
    """Return the validation as `symid validate --json` gives it."""
    return {
        "robot": validation.robot,
        "log": validation.source,
        "rows": validation.rows,
        "samples": validation.samples,
        "residual": describe_residual(validation.residual),
        "mean_relative_percent": validation.mean_relative_percent,
    }


def describe_residual(residual: Sequence["Residual"]) -> list[dict[str, object]]:
    """Return one object a joint."""
    return [
        {
            "joint": entry.joint,
            "norm": entry.norm,
            "relative_percent": entry.relative_percent,
            "std": entry.std,
            "samples": entry.samples,
            "unit": entry.unit,
        }
        for entry in residual
    ]


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
            near = None if entry.truth is None else abs(entry.value - entry.truth) <= 3.0 * entry.std
            row += [entry.truth, near]
    return format_table(header, rows, left=(0, 4))


def show_residual(residual: Sequence["Residual"]) -> Table:
    """Return the table of residuals."""
    rows = [
        [entry.joint, entry.norm, f"{entry.relative_percent:.4f}", entry.std, entry.unit, entry.samples]
        for entry in residual
    ]
    return format_table(("joint", "norm", "relative/%", "std", "unit", "samples"), rows, left=(0, 4))


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
    return format_table(header, rows, left=(0, 4))
