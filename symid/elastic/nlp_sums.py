"""How rows add up what happens between samples: windows, and the low-pass of the filtered rows.

Input: means of a signal over the steps between samples. Output: one value a row; and the adjoint, from
multipliers of rows back to steps, which second derivatives need.

    window   y_k = sum_{i in window k} weight_i x_i
    filter   y_k = sum_{i < end k} (1 - a) a^(end k - 1 - i) x_i,   a = exp(-rate period)

Supported: windows side by side; rows of the filter at every so many samples.
Not supported: windows that overlap.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from symid.arrays import FloatArray, freeze

__all__ = ["FilterSums", "StepSums", "WindowSums"]


class StepSums(Protocol):
    """A linear map from steps to rows."""

    def add(self, steps: FloatArray) -> FloatArray:
        """Return the rows (M, ...) of step means (N - 1, ...)."""
        ...

    def spread(self, rows: FloatArray) -> FloatArray:
        """Return the steps (N - 1,) that the adjoint makes of rows (M,)."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WindowSums:
    """Sums over `count` windows of `length` steps from step `first` on, with one weight a step (N - 1,)."""

    first: int
    length: int
    count: int
    weights: FloatArray

    def __post_init__(self) -> None:
        """Copy the weights and make them read-only."""
        object.__setattr__(self, "weights", freeze(self.weights))

    def add(self, steps: FloatArray) -> FloatArray:
        """Return the rows (M, ...) of step means (N - 1, ...)."""
        span = self._span
        blocks = steps[span].reshape(self.count, self.length, -1)
        weights = self.weights[span].reshape(self.count, 1, self.length)
        sums: FloatArray = np.matmul(weights, blocks).reshape(self.count, *steps.shape[1:])
        return sums

    def spread(self, rows: FloatArray) -> FloatArray:
        """Return the steps (N - 1,) that the adjoint makes of rows (M,)."""
        steps = np.zeros_like(self.weights)
        steps[self._span] = self.weights[self._span] * np.repeat(rows, self.length)
        return steps

    @property
    def _span(self) -> slice:
        return slice(self.first, self.first + self.count * self.length)


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterSums:
    """The low-pass from rest over `steps` steps, seen at the samples first, first + length, ...

    Args:
        steps: N - 1; count: rows.
        decay: exp(-rate period).
    """

    steps: int
    first: int
    length: int
    count: int
    decay: float

    def add(self, steps: FloatArray) -> FloatArray:
        """Return the rows (M, ...) of step means (N - 1, ...)."""
        from scipy.signal import lfilter

        flat = steps.reshape(self.steps, -1)
        inflow = np.empty((self.count, flat.shape[1]))
        inflow[0] = self._fade(self.first) @ flat[: self.first]
        last = self.first + (self.count - 1) * self.length
        blocks = flat[self.first : last].reshape(self.count - 1, self.length, flat.shape[1])
        inflow[1:] = np.matmul(self._fade(self.length), blocks)
        rows: FloatArray = lfilter([1.0], [1.0, -(self.decay**self.length)], inflow, axis=0)
        return rows.reshape(self.count, *steps.shape[1:])

    def spread(self, rows: FloatArray) -> FloatArray:
        """Return the steps (N - 1,) that the adjoint makes of rows (M,)."""
        from scipy.signal import lfilter

        outflow = lfilter([1.0], [1.0, -(self.decay**self.length)], rows[::-1])[::-1]
        steps = np.zeros(self.steps)
        steps[: self.first] = outflow[0] * self._fade(self.first)
        last = self.first + (self.count - 1) * self.length
        steps[self.first : last] = np.outer(outflow[1:], self._fade(self.length)).ravel()
        return steps

    def _fade(self, length: int) -> FloatArray:
        """Return what is left of each of `length` steps at the end of the last."""
        weights: FloatArray = (1.0 - self.decay) * self.decay ** np.arange(
            length - 1, -1, -1, dtype=np.float64
        )
        return weights
