"""Friction with a memory in symbols: the same definitions over SymPy, and in LaTeX.

Input: a `DynamicLaw`. Output: expressions in the velocity, the deflection, the period and the parameters.

Supported: every law of `friction_dynamic`; numbers of high precision by `evalf` on what is given here.
Not supported: simplification; the expressions are those that the code computes.
"""

from dataclasses import dataclass, replace
from typing import Any

from symid.joint.friction_dynamic import (
    DynamicLaw,
    find_bristle_rate,
    find_bristle_step,
    find_dynamic_torque,
    find_steady_torque,
)
from symid.joint.friction_law import OperatorFriction

__all__ = ["DynamicEquations", "build_symbol_carrier", "derive_equations", "find_latex"]

Expression = Any
"""A SymPy expression; SymPy is loaded only where it is used, and has no types."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DynamicEquations:
    """A law in symbols.

    Args:
        velocity, state, period: the symbols v, z, h; values: those of the parameters, in the law's order.
        level: g(v); rate: dz/dt; torque: at v and z; steady: after a long time at v.
        state_after, torque_after: after h s at v, beginning from z.
    """

    velocity: Expression
    state: Expression
    period: Expression
    values: tuple[Expression, ...]
    level: Expression
    rate: Expression
    torque: Expression
    steady: Expression
    state_after: Expression
    torque_after: Expression


def build_symbol_carrier() -> OperatorFriction[Expression]:
    """Return the carrier of SymPy expressions."""
    import sympy

    return OperatorFriction(
        zero=sympy.Integer(0),
        one=sympy.Integer(1),
        exp=sympy.exp,
        tanh=sympy.tanh,
        sin=sympy.sin,
        cos=sympy.cos,
        sign=sympy.sign,
        absolute=sympy.Abs,
        maximum=sympy.Max,
        minimum=sympy.Min,
    )


def derive_equations(law: DynamicLaw) -> DynamicEquations:
    """Return the law over real symbols; those of the parameters are positive."""
    import sympy

    algebra = build_symbol_carrier()
    velocity, state = sympy.symbols("v z", real=True)
    period = sympy.Symbol("h", positive=True)
    values = tuple(sympy.Symbol(name, positive=True) for name in law.names)
    after, torque_after = find_bristle_step(algebra, law, (velocity, period), state, values)
    return DynamicEquations(
        velocity=velocity,
        state=state,
        period=period,
        values=values,
        level=law.level(algebra, velocity, values),
        rate=find_bristle_rate(algebra, law, velocity, state, values),
        torque=find_dynamic_torque(algebra, law, velocity, state, values),
        steady=find_steady_torque(algebra, law, velocity, values),
        state_after=after,
        torque_after=torque_after,
    )


def find_latex(law: DynamicLaw) -> tuple[str, ...]:
    r"""Return the equations in LaTeX: level, rate of the deflection, torque, step.

    After the first the level is written g, in the torque the rate \dot z: as papers print them.
    """
    import sympy

    algebra = build_symbol_carrier()
    equations = derive_equations(law)
    v, z, h, values = equations.velocity, equations.state, equations.period, equations.values
    g, rate, after, torque = sympy.symbols("g z_rate z_after tau", positive=True)
    short = replace(law, level=lambda _algebra, _velocity, _values: g)
    damping, viscous = law.damping(algebra, values)
    step, _ = find_bristle_step(algebra, short, (v, h), z, values)
    rows = (
        (g, equations.level),
        (rate, find_bristle_rate(algebra, short, v, z, values)),
        (torque, values[0] * z + damping * rate + viscous * v),
        (after, step),
    )
    names = {symbol: parameter.latex for symbol, parameter in zip(values, law.parameters, strict=True)}
    names |= {g: "g", rate: r"\dot z", torque: r"\tau_f", after: "z_+"}
    return tuple(f"{names[left]} = {sympy.latex(right, symbol_names=names)}" for left, right in rows)
