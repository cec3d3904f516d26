"""A NumPy function that CasADi can call, as Ipopt does: names, sparsities, and what computes it.

Named arguments and results with their sparsities, a NumPy function -> a CasADi callback. CasADi is loaded
on first use.

Supported: dense and sparse arguments and results.
Not supported: derivatives by CasADi; give them as functions of their own.
"""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

Slots = tuple[tuple[str, Any], ...]
"""Name and CasADi sparsity of every argument, or of every result."""


def build_callback(
    name: str, takes: Slots, gives: Slots, evaluate: Callable[[Sequence[Any]], list[Any]]
) -> Any:  # noqa: ANN401  of casadi
    """Return the callback; it must live as long as the solver that calls it."""
    return _load_class()(name, takes, gives, evaluate)


@cache
def _load_class() -> Callable[..., Any]:
    """Return the class of callbacks; CasADi is loaded only when it is asked for."""
    import casadi

    class NumpyFunction(casadi.Callback):
        """A function with named arguments and results of known sparsity."""

        def __init__(
            self, name: str, takes: Slots, gives: Slots, evaluate: Callable[[Sequence[Any]], list[Any]]
        ) -> None:
            casadi.Callback.__init__(self)
            self.takes, self.gives, self.evaluate = takes, gives, evaluate
            self.construct(name, {})

        def get_n_in(self) -> int:
            return len(self.takes)

        def get_n_out(self) -> int:
            return len(self.gives)

        def get_name_in(self, place: int) -> str:
            return self.takes[place][0]

        def get_name_out(self, place: int) -> str:
            return self.gives[place][0]

        def get_sparsity_in(self, place: int) -> Any:  # noqa: ANN401  # of casadi
            return self.takes[place][1]

        def get_sparsity_out(self, place: int) -> Any:  # noqa: ANN401  # the same
            return self.gives[place][1]

        def eval(self, arguments: Sequence[Any]) -> list[Any]:
            return self.evaluate(arguments)

    return NumpyFunction
