"""What the hysteresis-plus-friction problem may be told: rows, friction, knees, bounds, Hessian.

Input: numbers and names. Output: `NlpOptions`.

Supported: exact and Gauss-Newton Hessians.
Not supported: approximations of the Hessian from gradients.
"""

import math
from dataclasses import dataclass

from symid.elastic.nlp_rows import NLP_ROWS
from symid.errors import Notice, UsageError

__all__ = ["HESSIANS", "NlpOptions"]

HESSIANS = ("exact", "gauss-newton")


@dataclass(frozen=True, slots=True, kw_only=True)
class NlpOptions:
    """How the problem is set up and solved.

    Args:
        rows: some of `NLP_ROWS`.
        hessian: one of `HESSIANS`.
        stribeck: whether friction gets Fs exp(-(v / vs)^2) sign(v) on top.
        smoothing: v0 of tanh(v / v0) in place of sign(v) in it, rad/s or m/s; 0 for the sign.
        speeds: least and greatest vs, rad/s or m/s.
        odd: whether springs harden alike on both sides.
        slopes: least and greatest slope of the outer function.
        weight_limit: greatest weight as a multiple of the linear spring; least_stiffness: the least k0.
        rounds: of weighing the rows by their residuals; 0 keeps the weights of the linear springs.
        tolerance: of Ipopt, on the scaled problem.
        iterations: of Ipopt, at most.
    """

    rows: tuple[str, ...] = ("energy", "momentum")
    hessian: str = "exact"
    stribeck: bool = False
    smoothing: float = 0.0
    speeds: tuple[float, float] = (1e-3, 10.0)
    odd: bool = False
    slopes: tuple[float, float] = (0.05, 20.0)
    weight_limit: float = 100.0
    least_stiffness: float = 1e-3
    rounds: int = 2
    tolerance: float = 1e-9
    iterations: int = 200

    def __post_init__(self) -> None:
        """Check what every later stage relies on.

        Raises:
            UsageError: with all that is wrong.
        """
        mistakes = [*_find_name_mistakes(self), *_find_number_mistakes(self)]
        if mistakes:
            raise UsageError(*(Notice(code="usage.nlp-option", text=text) for text in mistakes))


def _find_name_mistakes(options: NlpOptions) -> list[str]:
    mistakes = []
    if not options.rows or any(kind not in NLP_ROWS for kind in options.rows):
        mistakes.append(f"rows {options.rows}: must be some of {', '.join(NLP_ROWS)}")
    if len(set(options.rows)) < len(options.rows):
        mistakes.append(f"rows {options.rows}: each kind once")
    if options.hessian not in HESSIANS:
        mistakes.append(f"hessian {options.hessian!r}: allowed are {', '.join(HESSIANS)}")
    return mistakes


def _find_number_mistakes(options: NlpOptions) -> list[str]:
    mistakes = []
    for name in ("speeds", "slopes"):
        low, high = getattr(options, name)
        if not 0.0 < low < high < math.inf:
            mistakes.append(f"{name} ({low:g}, {high:g}): must be positive, the least first")
    low, high = options.slopes
    if not low < 1.0 < high:
        mistakes.append(
            f"slopes ({low:g}, {high:g}): one must lie between them, it is the slope at zero torque"
        )
    mistakes += [
        f"{name} {getattr(options, name):g}: must be a positive number"
        for name in ("weight_limit", "least_stiffness", "tolerance")
        if not 0.0 < getattr(options, name) < math.inf
    ]
    if not 0.0 <= options.smoothing < math.inf:
        mistakes.append(f"smoothing {options.smoothing:g}: must be a speed, or 0")
    for name, least in (("rounds", 0), ("iterations", 1)):
        if getattr(options, name) < least:
            mistakes.append(f"{name} {getattr(options, name)}: must be {least} or more")
    return mistakes
