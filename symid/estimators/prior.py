"""What is known of parameters before a log is looked at.

Input: the values of a model card (CAD data of the robot file), or an estimate. Output: `Prior`.

Supported: values for some of the parameters; deviations that grow with the values.
Not supported: priors with correlations.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.functions import ModelCard
from symid.errors import Notice, UsageError
from symid.estimators.estimate import Estimate

__all__ = ["Prior", "build_prior_of_card", "build_prior_of_estimate"]

_SMALL = 0.1
"""Part of the root mean square of the values in one unit that counts as the size of a smaller one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Prior:
    """Values and standard deviations of named parameters in SI units; `source` says whence, in words."""

    names: tuple[str, ...]
    values: tuple[float, ...]
    deviations: tuple[float, ...]
    source: str

    def arrange(self, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        """Return values and deviations (p,) in the order of `names`; 0 and infinite where unknown."""
        known = {name: pair for name, *pair in zip(self.names, self.values, self.deviations, strict=True)}
        pairs = np.array([known.get(name, [0.0, np.inf]) for name in names], dtype=np.float64)
        return pairs[:, 0], pairs[:, 1]


def build_prior_of_card(card: ModelCard, fraction: float) -> Prior:
    """Return the values that the robot file states, each known to `fraction` of its size.

    The size of a value that is smaller than a tenth of the root mean square of those in its unit is that
    tenth: a first moment that a drawing has at zero is not known exactly.

    Raises:
        UsageError: the robot file states none.
    """
    stated = [entry for entry in (*card.beta, *card.friction) if entry.value is not None]
    if not stated:
        text = (
            f"the robot file of {card.robot!r} states no values to stay near to: give inertial parameters "
            "there, or an estimate as --prior FILE"
        )
        raise UsageError(Notice(code="usage.no-prior", text=text))
    values = np.array([float(entry.value or 0.0) for entry in stated])
    units = np.array([entry.unit for entry in stated])
    usual = np.array([np.sqrt(np.mean(values[units == unit] ** 2)) for unit in units])
    sizes = np.maximum(np.abs(values), _SMALL * usual)
    # Where all values of a unit are zero nothing tells a size: nothing is known of these.
    deviations = np.where(sizes > 0.0, fraction * sizes, np.inf)
    return Prior(
        names=tuple(entry.name for entry in stated),
        values=tuple(values.tolist()),
        deviations=tuple(deviations.tolist()),
        source=f"robot file, each known to {100.0 * fraction:g} %",
    )


def build_prior_of_estimate(estimate: Estimate, factor: float = 1.0) -> Prior:
    """Return the values of an estimate, known to `factor` times their standard deviations."""
    return Prior(
        names=tuple(entry.name for entry in estimate.parameters),
        values=tuple(entry.value for entry in estimate.parameters),
        deviations=tuple(factor * entry.std for entry in estimate.parameters),
        source=f"estimate of {', '.join(estimate.sources)}, its deviations times {factor:g}",
    )
