"""A cost in NumPy as functions that CasADi's solvers call: value, gradient, Hessian.

Three functions of scaled unknowns -> CasADi functions in the form that its interface to Ipopt asks for.

Supported: costs without constraints other than bounds.
Not supported: parameters of the problem.
"""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np

from symid.arrays import FloatArray

__all__ = ["build_callbacks"]

Cost = Callable[[FloatArray], float]
Array = Callable[[FloatArray], FloatArray]


def build_callbacks(size: int, value: Cost, gradient: Array, hessian: Array) -> dict[str, Any]:
    """Return "value", "gradient" and "hessian", which must live as long as the solver.

    Args:
        size: number of unknowns.
        value: of the cost.
        gradient: (size,).
        hessian: (size, size).
    """
    import casadi

    one, none, column = (casadi.Sparsity.dense(*shape) for shape in ((1, 1), (0, 0), (size, 1)))
    upper = casadi.Sparsity.upper(size)
    # Column by column, as CasADi stores the upper triangle.
    rows = np.concatenate([np.arange(end + 1) for end in range(size)])
    order = rows, np.repeat(np.arange(size), np.arange(1, size + 1))

    def read(unknowns: Any) -> FloatArray:  # noqa: ANN401  # an array of casadi
        return np.asarray(unknowns, dtype=np.float64).ravel()

    def find_hessian(unknowns: Any, _parameters: Any, factor: Any, _multipliers: Any) -> list[Any]:  # noqa: ANN401
        full = hessian(read(unknowns)) * float(factor)
        return [casadi.DM(upper, full[order])]

    build = _load_callback_class()
    return {
        "value": build({"x": column}, {"f": one}, lambda x: [value(read(x))]),
        "gradient": build(
            {"x": column, "p": none},
            {"f": one, "grad_f_x": column},
            lambda x, _p: [value(read(x)), gradient(read(x))],
        ),
        "hessian": build(
            {"x": column, "p": none, "lam_f": one, "lam_g": none},
            {"triu_hess_gamma_x_x": upper},
            find_hessian,
        ),
    }


@cache
def _load_callback_class() -> Callable[..., Any]:
    """Return the class of callbacks; CasADi is loaded only here."""
    import casadi

    class Callback(casadi.Callback):
        """A function of arrays; `inputs` and `outputs` map names to sparsities."""

        def __init__(
            self, inputs: dict[str, Any], outputs: dict[str, Any], evaluate: Callable[..., list[Any]]
        ) -> None:
            casadi.Callback.__init__(self)
            self.inputs, self.outputs, self.evaluate = inputs, outputs, evaluate
            self.construct(list(outputs)[-1], {})

        def get_n_in(self) -> int:
            return len(self.inputs)

        def get_n_out(self) -> int:
            return len(self.outputs)

        def get_name_in(self, place: int) -> str:
            return list(self.inputs)[place]

        def get_name_out(self, place: int) -> str:
            return list(self.outputs)[place]

        def get_sparsity_in(self, place: int) -> Any:  # noqa: ANN401  # of casadi
            return list(self.inputs.values())[place]

        def get_sparsity_out(self, place: int) -> Any:  # noqa: ANN401  # the same
            return list(self.outputs.values())[place]

        def eval(self, arguments: Sequence[Any]) -> list[Any]:
            return self.evaluate(*arguments)

    return Callback
