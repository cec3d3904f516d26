"""A function of NumPy as one that Ipopt calls through CasADi: value, gradient, Hessian.

Three functions of the unknowns -> what `casadi.nlpsol` takes for f, "grad_f" and "hess_lag".

Supported: problems whose only constraints are bounds.
Not supported: parameters of the problem.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from symid.arrays import FloatArray
from symid.callbacks import build_callback

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
    return IpoptFunctions(
        value=build_callback("value", (("x", unknowns),), (("f", scalar),), find_value),
        gradient=build_callback(
            "gradient", (("x", unknowns), ("p", none)), (("f", scalar), ("grad_f_x", unknowns)), find_slope
        ),
        hessian=build_callback(
            "hessian",
            (("x", unknowns), ("p", none), ("lam_f", scalar), ("lam_g", none)),
            (("triu_hess_gamma_x_x", upper),),
            find_bend,
        ),
    )
