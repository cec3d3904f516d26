"""A library whose model card states other values, so that the plant of simulations takes them.

Input: a library, parameters. Output: `ValuedLibrary`, which calls the same functions.

Supported: base parameters and friction. Not supported: other names or orders of parameters.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from symid.arrays import FloatArray
from symid.codegen.calls import Call
from symid.codegen.functions import ModelCard
from symid.codegen.library import Library
from symid.errors import Notice

__all__ = ["ValuedLibrary", "state_values"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ValuedLibrary:
    """The functions of `inner` beside the values of `card`."""

    inner: Library
    card: ModelCard

    @property
    def backend(self) -> str:
        """Return what the functions run as."""
        return self.inner.backend

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return what is worth saying of the library."""
        return self.inner.notices

    def evaluate(
        self, name: str, *inputs: FloatArray, out: Sequence[FloatArray] | None = None
    ) -> tuple[FloatArray, ...]:
        """Return what the function of `inner` returns."""
        return self.inner.evaluate(name, *inputs, out=out)

    def bind(self, name: str, *, out: Sequence[FloatArray] | None = None) -> Call:
        """Return the function of `inner`, bound."""
        return self.inner.bind(name, out=out)


def state_values(card: ModelCard, values: FloatArray) -> ModelCard:
    """Return the card with `values` (p,), base parameters first, then friction, in SI units."""
    split = len(card.beta)
    beta = zip(card.beta, values[:split].tolist(), strict=True)
    friction = zip(card.friction, values[split:].tolist(), strict=True)
    return replace(
        card,
        beta=tuple(replace(entry, value=number) for entry, number in beta),
        friction=tuple(replace(entry, value=number) for entry, number in friction),
    )
