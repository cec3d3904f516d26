"""A function of NumPy as one that Ipopt calls through CasADi: value, gradient, Hessian.

Three functions of the unknowns -> what `casadi.nlpsol` takes for f, "grad_f" and "hess_lag".

Supported: problems whose only constraints are bounds.
Not supported: parameters of the problem.
"""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from symid.arrays import FloatArray

__all__ = ["IpoptFunctions", "build_ipopt_functions"]


class IpoptFunctions(NamedTuple):
    """Functions of CasADi; they must live as long as the solver that calls them."""

    value: Any
    gradient: Any
    hessian: Any


def build_ipopt_functions(
    size: int,
    value: Callable[[FloatArray], float],
    gradient: Callable[[FloatArray], FloatArray],
    hessian: Callable[[FloatArray], FloatArray],
) -> IpoptFunctions:
    """Return the functions of CasADi.

    Args:
        size: number n of unknowns.
        value: f of unknowns (n,).
        gradient: (n,).
        hessian: (n, n), symmetric.
    """
    import casadi

    dense = casadi.Sparsity.dense
    upper = casadi.Sparsity.upper(size)
    inner = np.triu_indices(size)
    # CasADi stores columns one after the other.
    order = np.lexsort((inner[0], inner[1]))
    rows, columns = inner[0][order], inner[1][order]

    def read(unknowns: object) -> FloatArray:
        return np.array(unknowns, dtype=np.float64).ravel()

    def find_value(arguments: Sequence[Any]) -> list[Any]:
        return [value(read(arguments[0]))]

    def find_slope(arguments: Sequence[Any]) -> list[Any]:
        x = read(arguments[0])
        return [value(x), casadi.DM(gradient(x))]

    def find_bend(arguments: Sequence[Any]) -> list[Any]:
        full = float(arguments[2]) * hessian(read(arguments[0]))
        return [casadi.DM(upper, full[rows, columns])]

    unknowns, scalar, none = dense(size, 1), dense(1, 1), dense(0, 0)
    build = _load_class()
    return IpoptFunctions(
        value=build("value", (("x", unknowns),), (("f", scalar),), find_value),
        gradient=build(
            "gradient", (("x", unknowns), ("p", none)), (("f", scalar), ("grad_f_x", unknowns)), find_slope
        ),
        hessian=build(
            "hessian",
            (("x", unknowns), ("p", none), ("lam_f", scalar), ("lam_g", none)),
            (("triu_hess_gamma_x_x", upper),),
            find_bend,
        ),
    )


Slots = tuple[tuple[str, Any], ...]


@cache
def _load_class() -> Callable[..., Any]:
    """Return the class; CasADi is loaded only when it is asked for."""
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
