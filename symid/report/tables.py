"""Rows of the tables that reports have in common, ready to print.

Input: parameters, residuals, settings. Output: records of strings.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from symid.estimators.estimate import ParameterEstimate, Residual

__all__ = [
    "ParameterLine",
    "ResidualLine",
    "list_settings",
    "write_digits",
    "write_error",
    "write_parameter",
    "write_residual",
]

_UNKNOWN = "\N{EN DASH}"


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterLine:
    """A row of the parameter table; `truth`, `error` and `inside` may be empty."""

    name: str
    value: str
    std: str
    relative: str
    unit: str
    truth: str
    error: str
    inside: str
    expression: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ResidualLine:
    """A row of a residual table."""

    joint: str
    norm: str
    relative: str
    std: str
    samples: str
    unit: str


def write_parameter(entry: ParameterEstimate) -> ParameterLine:
    """Return the row of one parameter; its error is relative to the true value, where that is not zero."""
    truth, error, inside = "", "", ""
    relative = entry.relative_std_percent
    if entry.truth is not None:
        truth = f"{entry.truth:.5g}"
        if math.isfinite(entry.std):
            inside = "yes" if abs(entry.value - entry.truth) <= 3.0 * entry.std else "no"
        if entry.truth:
            error = write_error(entry.value, entry.truth)
    return ParameterLine(
        name=entry.name,
        value=f"{entry.value:.5g}",
        std=write_digits(entry.std) if math.isfinite(entry.std) else _UNKNOWN,
        relative=f"{write_digits(relative)} %" if math.isfinite(relative) else _UNKNOWN,
        unit=entry.unit,
        truth=truth,
        error=error,
        inside=inside,
        expression="" if entry.expression == entry.name else entry.expression,
        reason=entry.reason,
    )


def write_error(value: float, truth: float) -> str:
    """Return the error relative to a true value that is not zero, with its sign."""
    percent = 100.0 * (value - truth) / abs(truth)
    sign = "\N{MINUS SIGN}" if percent < 0.0 else "+"
    return f"{sign}{write_digits(abs(percent))} %"


def write_digits(value: float) -> str:
    """Return two digits, more from 100 on, where two would need a power of ten."""
    return f"{value:.0f}" if 99.5 <= value < 1e6 else f"{value:.2g}"


def write_residual(entry: Residual) -> ResidualLine:
    """Return the row of one joint's residual."""
    return ResidualLine(
        joint=entry.joint,
        norm=f"{entry.norm:.5g}",
        relative=f"{entry.relative_percent:.4f} %",
        std=f"{entry.std:.4g}",
        samples=str(entry.samples),
        unit=entry.unit,
    )


def list_settings(value: object, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Yield every setting of nested tables with its dotted name."""
    if isinstance(value, Mapping):
        for key, entry in value.items():
            yield from list_settings(entry, f"{prefix}.{key}" if prefix else str(key))
    elif isinstance(value, list | tuple):
        yield prefix, ", ".join(map(str, value))
    else:
        yield prefix, "none" if value is None else str(value)
