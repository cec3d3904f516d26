"""Friction with a state: bristles that bend before they slip, over any carrier. Dahl, LuGre, Maxwell-slip.

    dz/dt = v - sigma0 |v| / g(v) z
    tau_f = sigma0 z + sigma1 dz/dt + fV v                       positive against positive velocity
    Dahl:  g = fC, sigma1 = 0
    LuGre: g = fC + (fS - fC) exp(-|v / vs|^gamma)
    v held over h:  z(h) = z_e + (z - z_e) exp(-sigma0 |x| / g),  z_e = g sign(x) / sigma0,  x = v h

The step is exact while the velocity is held, therefore stable for any length. Dahl, Aerospace Corporation
report TOR-0158(3107-18)-1 (1968); Canudas de Wit, Olsson, Astrom, Lischinsky, IEEE Trans. Automatic Control
40 (1995) 419-425. Elements of Maxwell-slip are springs that slip at their share a_k of g:

    z_k(x) = clamp(z_k + x, -+ a_k g / s_k),  tau_f = sum of s_k z_k + fV v           s_k: stiffness

Values have names: those of robot files (Fc, Fv, Fe) for `advance_memory`, fC, fV, fS as papers print them.

Supported: `STATE_LAWS` of the catalogue; any carrier; a velocity at the end other than that of the way.
Not supported: Dahl's exponent other than one, sigma1 that depends on the velocity, turning back in a step;
attraction of Maxwell-slip elements that takes time; equations in symbols of laws with elements.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from symid.arrays import FloatArray
from symid.errors import Notice, UsageError
from symid.joint_models import carriers
from symid.joint_models.friction_catalogue import STATE_LAWS
from symid.joint_models.friction_law import FrictionLaw, FrictionValues, LawParameter

V = TypeVar("V")


def name_bristles(law: FrictionLaw, bristles: Sequence[float]) -> dict[str, tuple[float, ...]]:
    """Return the values of a law's bristles by name, as a robot file has them: one, or one an element."""
    count = len(bristles) // len(law.memory) if law.memory else 0
    return {entry.name: tuple(bristles[k * count : (k + 1) * count]) for k, entry in enumerate(law.memory)}


def count_states(law: FrictionLaw | None, friction: FrictionValues) -> int:
    """Return how many deflections a joint's friction remembers: 0 without bristles."""
    return len(friction.bristles) // len(law.memory) if law is not None and law.memory else 0


def list_state_parameters(law: FrictionLaw, count: int = 0) -> tuple[LawParameter, ...]:
    """Return the parameters of bristles, or of `count` elements numbered from one, then those of `physical`.

    A UsageError for a law without a state, and for one with elements where they are not counted.
    """
    if not law.memory or (law.elements and not count):
        known = (name for name, entry in STATE_LAWS.items() if not entry.elements)
        text = f"friction law {law.name!r} has no bristles; laws that have: {', '.join(known)}"
        raise UsageError(Notice(code="joint.no-bristles", text=text))
    numbers = range(1, count + 1) if law.elements else ("",)
    state = (replace(entry, name=f"{entry.name}{number}") for entry in law.memory for number in numbers)
    return (*state, *law.physical)


def list_memory_values(law: FrictionLaw, friction: FrictionValues) -> dict[str, float]:
    """Return shape values and bristles by name, elements numbered from one, their shares with sum one."""
    found = dict(zip((entry.name for entry in law.shape), friction.shape, strict=True))
    entries = list_state_parameters(law, count_states(law, friction))
    found |= {entry.name: value for entry, value in zip(entries, friction.bristles, strict=False)}
    whole = math.fsum(value for name, value in found.items() if name.startswith("share"))
    return {name: value / whole if name.startswith("share") else value for name, value in found.items()}


def convert_printed(algebra: carriers.Carrier[V], law: FrictionLaw, printed: Mapping[str, V]) -> dict[str, V]:
    """Return the values that `advance_memory` takes from those of `list_state_parameters`, all by name."""
    names = [entry.name for entry in law.physical]
    state = {name: value for name, value in printed.items() if name not in names}
    own = law.unmix(algebra, [printed[name] for name in names])
    return state | dict(zip((entry.name for entry in (*law.linear, *law.shape)), own, strict=True))


def build_memory_values(law: FrictionLaw, printed: Mapping[str, float]) -> dict[str, float]:
    """Return the values that `advance_memory` takes from sigma0, fC, ..., or stiffness1, share1, fC, ...

    A UsageError for missing or unknown names, values not finite or out of bounds, shares whose sum is not 1.
    """
    entries = list_state_parameters(law, max(1, sum(name.startswith("stiffness") for name in printed)))
    mistakes = []
    if {entry.name for entry in entries} != printed.keys():
        names = ", ".join(entry.name for entry in entries)
        mistakes, entries = [f" takes {names}, got {', '.join(printed)}"], ()
    for entry in entries:
        value, upper = printed[entry.name], f" and at most {entry.upper:g}" if entry.upper < math.inf else ""
        inside = entry.lower <= value if entry.lower_is_allowed else entry.lower < value
        if not (inside and math.isfinite(value) and value <= entry.upper):
            bounds = f"{'at least' if entry.lower_is_allowed else 'above'} {entry.lower:g}{upper}"
            mistakes.append(f": {entry.name} ({entry.meaning}) must be {bounds}, got {value:g}")
    whole = math.fsum(value for name, value in printed.items() if name.startswith("share"))
    if law.elements and not mistakes and abs(whole - 1.0) > _LARGEST_GAP:
        mistakes.append(f": the shares of all elements must have the sum 1, got {whole:.7g}")
    if mistakes:
        texts = (f"friction {law.name!r}{text}" for text in mistakes)
        raise UsageError(*(Notice(code="joint.friction-values", text=text) for text in texts))
    return convert_printed(carriers.build_float_carrier(), law, printed)


_LEAST_LEVEL = 1e-9
"""N m or N, in place of a level that is not positive: bristles that hardly bend."""
_LARGEST_GAP = 1e-6
"""Of the sum of all shares."""


def _compute_level(algebra: carriers.Carrier[V], values: Mapping[str, V], velocity: V) -> V:
    """Return g(v) > 0, N m or N, the largest torque of bristles and elements; `values` by name."""
    level = values["Fc"]
    if "Fe" in values:
        ratio = algebra.div(algebra.absolute(velocity), values["vs"])
        fall = algebra.exp(algebra.sub(algebra.zero, algebra.power(ratio, values["gamma"])))
        level = algebra.add(level, algebra.mul(values["Fe"], fall))
    return algebra.maximum(level, algebra.scale(_LEAST_LEVEL, algebra.one))


def _compute_rate(
    algebra: carriers.Carrier[V], values: Mapping[str, V], velocity: V, level: V, state: V
) -> V:
    share = algebra.div(algebra.mul(values["sigma0"], state), level)
    return algebra.sub(velocity, algebra.mul(algebra.absolute(velocity), share))


def advance_memory(
    algebra: carriers.Carrier[V], values: Mapping[str, V], velocity: V, way: V, states: Sequence[V]
) -> tuple[V, tuple[V, ...]]:
    """Return the friction of a joint after a way on which it does not turn back, and its deflections there.

    Args:
        algebra: of the numbers.
        values: linear values of the law (Fc, Fv, ...) and `list_memory_values`, by name.
        velocity: rad/s or m/s, of the level, and at the end.
        way: rad or m, velocity times period where held.
        states: deflections before it, rad or m.
    """
    level = _compute_level(algebra, values, velocity)
    after: list[V] = []
    if "sigma0" in values:
        # sigma0 z + sigma1 dz/dt.
        stiffness = values["sigma0"]
        turn = algebra.div(algebra.mul(stiffness, algebra.absolute(way)), level)
        decay = algebra.exp(algebra.sub(algebra.zero, turn))
        rest = algebra.div(algebra.mul(level, algebra.sign(way)), stiffness)
        after.append(algebra.add(rest, algebra.mul(algebra.sub(states[0], rest), decay)))
        torque = algebra.mul(stiffness, after[0])
        if "sigma1" in values:
            rate = _compute_rate(algebra, values, velocity, level, after[0])
            torque = algebra.add(torque, algebra.mul(values["sigma1"], rate))
    else:
        # Springs, each held within what its share bears.
        torque = algebra.zero
        for number, state in enumerate(states, start=1):
            stiffness = values[f"stiffness{number}"]
            most = algebra.div(algebra.mul(values[f"share{number}"], level), stiffness)
            bent = algebra.minimum(algebra.add(state, way), most)
            after.append(algebra.maximum(bent, algebra.sub(algebra.zero, most)))
            torque = algebra.add(torque, algebra.mul(stiffness, after[-1]))
    torque = algebra.add(torque, algebra.mul(values["Fv"], velocity))
    return algebra.add(torque, values["offset"]) if "offset" in values else torque, tuple(after)


def is_passive(values: Mapping[str, float]) -> bool | None:
    """Return whether velocity to torque is passive, storage in the springs; None where it is not known.

    v tau_f - sigma0 z dz/dt = sigma0 a z^2 + (sigma1 + fV) v^2 - sigma1 a z v with a = sigma0 |v| / g, and
    |a z v| <= v^2 max g / min g: fV >= sigma1 (max g - min g) / min g suffices. Compare Barabanov and Ortega,
    IEEE Transactions on Automatic Control 45 (2000) 675-686.
    """
    excess = values.get("Fe", 0.0)
    least = min(values["Fc"], values["Fc"] + excess)
    return values.get("Fv", 0.0) * least >= values.get("sigma1", 0.0) * abs(excess) or None


def simulate_dynamic_friction(
    values: Mapping[str, float], velocity: FloatArray, way: FloatArray, states: Sequence[float] = ()
) -> tuple[FloatArray, FloatArray]:
    """Return friction (N,), N m or N, and deflections (N, K), rad or m, at the end of each way of a motion.

    Args:
        values: by name, of K elements, or bristles with K = 1.
        velocity: (N,) at the ends of the ways, rad/s or m/s.
        way: (N,) rad or m, velocity times period where held.
        states: deflections before the first way, rad or m; straight without.

    Raises:
        UsageError: unlike lengths, or numbers that are not finite.
    """
    if np.shape(velocity) != np.shape(way) or not np.all(np.isfinite([velocity, way])):
        text = "velocities and displacements must have one length and finite values"
        raise UsageError(Notice(code="joint.friction-path", text=text))
    algebra = carriers.build_float_carrier()
    states = tuple(states) or (0.0,) * max(1, sum(name.startswith("stiffness") for name in values))
    torques, rows = [], []
    for speed, step in zip(np.asarray(velocity).tolist(), np.asarray(way).tolist(), strict=True):
        torque, states = advance_memory(algebra, values, speed, step, states)
        torques.append(torque)
        rows.append(states)
    return np.array(torques), np.array(rows).reshape(len(rows), -1)


Expression = Any
"""A SymPy expression; SymPy is loaded only where it is used, and has no types."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DynamicEquations:
    """A law in symbols.

    Args:
        velocity, state, period: the symbols v, z, h; values: those of `list_state_parameters`, in this order.
        level: g(v); rate: dz/dt; torque: at v and z; steady: after a long time at v.
        state_after: the deflection after h s at v, beginning from z.
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


def derive_equations(law: FrictionLaw) -> DynamicEquations:
    """Return a law with bristles over real symbols; those of the parameters are positive.

    A UsageError for laws without bristles.
    """
    import sympy

    # The least level is for computing alone; -1.0 is an integer.
    algebra = replace(
        carriers.build_symbol_carrier(),
        maximum=lambda level, _least: level,
        scale=lambda factor, value: sympy.nsimplify(factor) * value,
    )
    velocity, state = sympy.symbols("v z", real=True)
    period = sympy.Symbol("h", positive=True)
    printed = {p.name: sympy.Symbol(p.name, positive=True) for p in list_state_parameters(law)}
    values = convert_printed(algebra, law, printed)
    torque, _ = advance_memory(algebra, values, velocity, algebra.zero, (state,))
    _, (after,) = advance_memory(algebra, values, velocity, velocity * period, (state,))
    level = _compute_level(algebra, values, velocity)
    columns = law.columns(algebra, {"velocity": velocity}, [values[entry.name] for entry in law.shape])
    return DynamicEquations(
        velocity=velocity,
        state=state,
        period=period,
        values=tuple(printed.values()),
        level=level,
        rate=_compute_rate(algebra, values, velocity, level, state),
        torque=torque,
        steady=sum(values[entry.name] * column for entry, column in zip(law.linear, columns, strict=True)),
        state_after=after,
    )


def write_dynamic_latex(law: FrictionLaw) -> tuple[str, ...]:
    r"""Return the equations of a law with bristles in LaTeX: level, rate of the deflection, torque, step.

    After the first the level is written g, in the torque the rate \dot z: as papers print them. A UsageError
    for laws without bristles.
    """
    import sympy

    equations = derive_equations(law)
    g, rate, after, torque = sympy.symbols("g z_rate z_after tau", positive=True)
    rows = (
        (g, equations.level),
        (rate, equations.rate.subs(equations.level, g)),
        (torque, equations.torque.subs(equations.rate, rate)),
        (after, equations.state_after.subs(equations.level, g)),
    )
    names = {p: entry.latex for p, entry in zip(equations.values, list_state_parameters(law), strict=True)}
    names |= {g: "g", rate: r"\dot z", torque: r"\tau_f", after: "z_+"}
    return tuple(f"{names[left]} = {sympy.latex(right, symbol_names=names)}" for left, right in rows)
