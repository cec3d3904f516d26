"""Friction with a state: bristles that bend before they slip. Dahl, LuGre, Maxwell-slip, over any carrier.

    dz/dt = v - sigma0 |v| / g(v) z
    tau_f = sigma0 z + sigma1 dz/dt + fV v                       positive against positive velocity
    Dahl:  g = fC, sigma1 = fV = 0
    LuGre: g = fC + (fS - fC) exp(-|v / vs|^gamma)
    v held over h:  z(h) = z_e + (z - z_e) exp(-sigma0 |v| h / g),  z_e = g sign(v) / sigma0

The step is exact while the velocity is held, therefore stable for any length. Dahl, Aerospace Corporation
report TOR-0158(3107-18)-1 (1968); Canudas de Wit, Olsson, Astrom, Lischinsky, IEEE Trans. Automatic Control
40 (1995) 419-425.

Joints of a robot have one of `STATE_LAWS` of the catalogue. What their bristles do follows the way x = v h;
elements of Maxwell-slip are springs that slip at their share a_k of g:

    z_k(x) = clamp(z_k + x, -+ a_k g / s_k),  tau_f = sum of s_k z_k + fV v           s_k: stiffness

Supported: any carrier; several runs in one recording; a velocity of the step other than that of the sample.
Not supported: Dahl's exponent other than one, sigma1 that depends on the velocity, turning back in a step;
attraction of Maxwell-slip elements that takes time.
"""

import difflib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np

from symid.arrays import FloatArray, freeze, freeze_fields
from symid.errors import Notice, UsageError
from symid.joint_models import carriers
from symid.joint_models.friction_law import FrictionLaw, FrictionValues, LawParameter, build_parameter

V = TypeVar("V")


@dataclass(frozen=True, slots=True, kw_only=True)
class DynamicLaw:
    """A friction model with the deflection of bristles as its state.

    Args:
        name: of the model.
        parameters: in the order of the values that the functions take.
        level: (carrier, velocity, values) -> g > 0, N m or N: the largest torque of the bristles.
        damping: (carrier, values) -> sigma1 and fV.
        formula: in ASCII.
    """

    name: str
    parameters: tuple[LawParameter, ...]
    level: Callable[[carriers.Carrier[V], V, Sequence[V]], V]
    damping: Callable[[carriers.Carrier[V], Sequence[V]], tuple[V, V]]
    formula: str

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the parameters."""
        return tuple(parameter.name for parameter in self.parameters)


def compute_bristle_rate(
    algebra: carriers.Carrier[V], law: DynamicLaw, velocity: V, state: V, values: Sequence[V]
) -> V:
    """Return dz/dt = v - sigma0 |v| / g(v) z, rad/s or m/s, at v in rad/s or m/s and z in rad or m.

    `values` are the parameters in the order of the law.
    """
    share = algebra.div(algebra.mul(values[0], state), law.level(algebra, velocity, values))
    return algebra.sub(velocity, algebra.mul(algebra.absolute(velocity), share))


def compute_dynamic_torque(
    algebra: carriers.Carrier[V], law: DynamicLaw, velocity: V, state: V, values: Sequence[V]
) -> V:
    """Return tau_f = sigma0 z + sigma1 dz/dt + fV v, N m or N; arguments as in `compute_bristle_rate`."""
    damping, viscous = law.damping(algebra, values)
    rate = compute_bristle_rate(algebra, law, velocity, state, values)
    moving = algebra.add(algebra.mul(damping, rate), algebra.mul(viscous, velocity))
    return algebra.add(algebra.mul(values[0], state), moving)


def compute_step_parts(
    algebra: carriers.Carrier[V], law: DynamicLaw, velocity: V, period: V, values: Sequence[V]
) -> tuple[V, V]:
    """Return exp(-sigma0 |v| h / g) and z_e = g sign(v) / sigma0: z(h) = z_e + (z - z_e) exp(...)."""
    level = law.level(algebra, velocity, values)
    way = algebra.mul(values[0], algebra.mul(algebra.absolute(velocity), period))
    decay = algebra.exp(algebra.sub(algebra.zero, algebra.div(way, level)))
    return decay, algebra.div(algebra.mul(level, algebra.sign(velocity)), values[0])


def compute_bristle_step(
    algebra: carriers.Carrier[V], law: DynamicLaw, held: tuple[V, V], state: V, values: Sequence[V]
) -> tuple[V, V]:
    """Return z after a step, exact for a held velocity, and the torque at its end.

    `held`: v during the step, rad/s or m/s, and its length h >= 0, s; the rest as in `compute_bristle_rate`.
    """
    velocity, period = held
    decay, rest = compute_step_parts(algebra, law, velocity, period, values)
    after = algebra.add(rest, algebra.mul(algebra.sub(state, rest), decay))
    return after, compute_dynamic_torque(algebra, law, velocity, after, values)


def compute_steady_torque(
    algebra: carriers.Carrier[V], law: DynamicLaw, velocity: V, values: Sequence[V]
) -> V:
    """Return g(v) sign(v) + fV v, N m or N: the torque after a long time at `velocity`."""
    _, viscous = law.damping(algebra, values)
    dry = algebra.mul(law.level(algebra, velocity, values), algebra.sign(velocity))
    return algebra.add(dry, algebra.mul(viscous, velocity))


def is_passive(law: DynamicLaw, values: Sequence[float]) -> bool | None:
    """Return whether velocity to torque is passive with storage sigma0 z^2 / 2; None where it is not known.

    v tau_f - sigma0 z dz/dt = sigma0 a z^2 + (sigma1 + fV) v^2 - sigma1 a z v with a = sigma0 |v| / g, and
    |a z v| <= v^2 max g / min g: fV >= sigma1 (max g - min g) / min g suffices. Compare Barabanov and Ortega,
    IEEE Transactions on Automatic Control 45 (2000) 675-686.
    """
    named = {"sigma1": 0.0, "fV": 0.0} | dict(zip(law.names, values, strict=True))
    levels = named["fC"], named.get("fS", named["fC"])
    return named["fV"] * min(levels) >= named["sigma1"] * (max(levels) - min(levels)) or None


def check_dynamic_values(law: DynamicLaw, values: Sequence[float]) -> None:
    """Refuse, by a UsageError, a wrong number of values, and those not finite or out of bounds."""
    mistakes = []
    if len(values) != len(law.parameters):
        mistakes.append(f" takes {len(law.names)} values ({', '.join(law.names)}), got {len(values)}")
    for parameter, value in () if mistakes else zip(law.parameters, values, strict=True):
        kept = value >= parameter.lower if parameter.lower_is_allowed else value > parameter.lower
        if not (math.isfinite(value) and kept and value <= parameter.upper):
            bound = "at least" if parameter.lower_is_allowed else "above"
            upper = f" and at most {parameter.upper:g}" if math.isfinite(parameter.upper) else ""
            text = f": {parameter.name} ({parameter.meaning}) must be {bound} {parameter.lower:g}{upper}"
            mistakes.append(f"{text}, got {value:g}")
    if mistakes:
        texts = (f"friction {law.name!r}{text}" for text in mistakes)
        raise UsageError(*(Notice(code="joint.friction-values", text=text) for text in texts))


def get_dynamic_law(name: str) -> DynamicLaw:
    """Return the model `name`, or raise a UsageError that lists all models and the nearest."""
    if name in DYNAMIC_LAWS:
        return DYNAMIC_LAWS[name]
    near = difflib.get_close_matches(name, DYNAMIC_LAWS, n=1)
    hint = f"; did you mean {near[0]!r}? Known" if near else ". Known"
    text = f"unknown friction law with a state {name!r}{hint}: {', '.join(DYNAMIC_LAWS)}"
    raise UsageError(Notice(code="joint.no-dynamic-friction", text=text))


def _compute_fall(algebra: carriers.Carrier[V], velocity: V, speed: V, exponent: V) -> V:
    ratio = algebra.div(algebra.absolute(velocity), speed)
    return algebra.exp(algebra.sub(algebra.zero, algebra.power(ratio, exponent)))


_positive = partial(build_parameter, allowed=False)
_STIFFNESS = _positive("sigma0", r"\sigma_0", "stiffness", "stiffness of the bristles")
_COULOMB = _positive("fC", "f_C", "level", "Coulomb friction")
_DAMPING = build_parameter("sigma1", r"\sigma_1", "viscous", "damping of the bristles")

BRISTLES = (_STIFFNESS, _DAMPING)
"""What LuGre remembers with; Dahl has the first."""
ELEMENTS = (
    _positive("stiffness", "s_k", "stiffness", "stiffness of each element"),
    _positive("share", "a_k", "number", "share of each element in dry friction; their sum is one", 0.0, 1.0),
)
"""The same of Maxwell-slip, a list each."""

DYNAMIC_LAWS: dict[str, DynamicLaw] = {
    law.name: law
    for law in (
        DynamicLaw(
            name="dahl",
            parameters=(_STIFFNESS, _COULOMB),
            level=lambda _algebra, _velocity, values: values[1],
            damping=lambda algebra, _values: (algebra.zero, algebra.zero),
            formula="dz/dt = v - sigma0 |v| / fC z, tau_f = sigma0 z",
        ),
        DynamicLaw(
            name="lugre",
            parameters=(
                _STIFFNESS,
                _DAMPING,
                _COULOMB,
                _positive("fS", "f_S", "level", "static friction, the level of break-away"),
                _positive("vs", "v_s", "speed", "Stribeck velocity"),
                build_parameter("gamma", r"\gamma", "number", "Stribeck exponent", 0.5, 4.0),
                build_parameter("fV", "f_V", "viscous", "viscous friction"),
            ),
            level=lambda algebra, velocity, values: algebra.add(
                values[2],
                algebra.mul(
                    algebra.sub(values[3], values[2]), _compute_fall(algebra, velocity, values[4], values[5])
                ),
            ),
            damping=lambda _algebra, values: (values[1], values[6]),
            formula=(
                "dz/dt = v - sigma0 |v| / g(v) z, g = fC + (fS - fC) exp(-|v / vs|^gamma), "
                "tau_f = sigma0 z + sigma1 dz/dt + fV v"
            ),
        ),
    )
}


def name_bristles(law: FrictionLaw, bristles: Sequence[float]) -> dict[str, tuple[float, ...]]:
    """Return the values of a law's bristles by name, as a robot file has them: one, or one an element."""
    count = len(bristles) // len(law.memory) if law.memory else 0
    return {entry.name: tuple(bristles[k * count : (k + 1) * count]) for k, entry in enumerate(law.memory)}


def count_states(law: FrictionLaw | None, friction: FrictionValues) -> int:
    """Return how many deflections a joint's friction remembers: 0 without bristles."""
    return len(friction.bristles) // len(law.memory) if law is not None and law.memory else 0


def list_memory_values(law: FrictionLaw, friction: FrictionValues) -> dict[str, float]:
    """Return shape values and bristles by name, elements numbered from one, their shares with sum one."""
    found = dict(zip((entry.name for entry in law.shape), friction.shape, strict=True))
    for name, values in name_bristles(law, friction.bristles).items():
        whole = math.fsum(values) if name == "share" else 1.0
        numbers = [""] if not law.elements else map(str, range(1, len(values) + 1))
        found |= {f"{name}{number}": value / whole for number, value in zip(numbers, values, strict=True)}
    return found


_LEAST_LEVEL = 1e-9
"""N m or N, in place of a level that is not positive: bristles that hardly bend."""


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
    level = values["Fc"]
    if "Fe" in values:
        fall = _compute_fall(algebra, velocity, values["vs"], values["gamma"])
        level = algebra.add(level, algebra.mul(values["Fe"], fall))
    level = algebra.maximum(level, algebra.scale(_LEAST_LEVEL, algebra.one))
    after: list[V] = []
    if "sigma0" in values:
        # sigma0 z + sigma1 dz/dt.
        stiffness = values["sigma0"]
        turn = algebra.div(algebra.mul(stiffness, algebra.absolute(way)), level)
        decay = algebra.exp(algebra.sub(algebra.zero, turn))
        rest = algebra.div(algebra.mul(level, algebra.sign(way)), stiffness)
        after.append(algebra.add(rest, algebra.mul(algebra.sub(states[0], rest), decay)))
        torque = bent = algebra.mul(stiffness, after[0])
        if "sigma1" in values:
            slip = algebra.mul(algebra.absolute(velocity), algebra.div(bent, level))
            torque = algebra.add(bent, algebra.mul(values["sigma1"], algebra.sub(velocity, slip)))
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


Numbers = Any
"""An array of real or complex numbers."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrictionPath:
    """A motion.

    Args:
        held: (N,) velocity held during the step that ends at the sample, rad/s or m/s: way over period.
        velocity: (N,) velocity at the sample, rad/s or m/s.
        period: (N,) length of the step, s; 0 where a run begins.
        start: (N,) whether the bristles are straight before the step: True where a run begins.
    """

    held: FloatArray
    velocity: FloatArray
    period: FloatArray
    start: FloatArray

    def __post_init__(self) -> None:
        """Copy the arrays; a UsageError for unlike lengths, numbers not finite, or a negative period."""
        freeze_fields(self)
        arrays = (self.held, self.velocity, self.period, self.start)
        alike = self.held.ndim == 1 and all(array.shape == self.held.shape for array in arrays)
        if not (alike and np.all(np.isfinite(arrays)) and np.all(self.period >= 0)):
            text = (
                "held, velocity, period and start must have one length, finite values and no negative period"
            )
            raise UsageError(Notice(code="joint.friction-path", text=text))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DynamicRun:
    """Torque (N,) in N m or N, and deflection of the bristles (N,) in rad or m, at the samples."""

    torque: FloatArray
    state: FloatArray


def build_held_path(velocity: FloatArray, period: float) -> FrictionPath:
    """Return the path whose sample k is the end of a step of `period` s at velocity k (N,), rad/s or m/s."""
    velocity = np.asarray(velocity, dtype=np.float64)
    start = np.zeros(velocity.shape)
    start[:1] = 1.0
    return FrictionPath(held=velocity, velocity=velocity, period=np.full(velocity.shape, period), start=start)


def _compute_run(law: DynamicLaw, values: Sequence[Numbers], path: FrictionPath, state: float) -> Numbers:
    algebra = carriers.build_complex_carrier()
    decay, rest = compute_step_parts(algebra, law, path.held, path.period, values)
    # z of the linear recursion, from `state` at the first sample and from zero at later starts.
    steps = np.broadcast_arrays(decay, rest, path.start, path.held)[:3]
    found: list[complex] = []
    for factor, goal, begins in zip(*(part.tolist() for part in steps), strict=True):
        before = (0.0 if begins else found[-1]) if found else state
        found.append(goal + factor * (before - goal))
    states = np.array(found, dtype=np.result_type(decay, rest))
    return compute_dynamic_torque(algebra, law, path.velocity, states, values), states


def simulate_dynamic_friction(
    law: DynamicLaw, values: Sequence[float], path: FrictionPath, *, state: float = 0.0
) -> DynamicRun:
    """Return the friction along a path, from deflection `state` rad or m; later runs begin straight.

    A UsageError for values out of bounds.
    """
    check_dynamic_values(law, values)
    torque, states = _compute_run(law, [np.float64(value) for value in values], path, state)
    return DynamicRun(torque=freeze(torque), state=freeze(states))


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


def derive_equations(law: DynamicLaw) -> DynamicEquations:
    """Return the law over real symbols; those of the parameters are positive."""
    import sympy

    algebra = carriers.build_symbol_carrier()
    velocity, state = sympy.symbols("v z", real=True)
    period = sympy.Symbol("h", positive=True)
    values = tuple(sympy.Symbol(name, positive=True) for name in law.names)
    after, torque_after = compute_bristle_step(algebra, law, (velocity, period), state, values)
    return DynamicEquations(
        velocity=velocity,
        state=state,
        period=period,
        values=values,
        level=law.level(algebra, velocity, values),
        rate=compute_bristle_rate(algebra, law, velocity, state, values),
        torque=compute_dynamic_torque(algebra, law, velocity, state, values),
        steady=compute_steady_torque(algebra, law, velocity, values),
        state_after=after,
        torque_after=torque_after,
    )


def write_dynamic_latex(law: DynamicLaw) -> tuple[str, ...]:
    r"""Return the equations in LaTeX: level, rate of the deflection, torque, step.

    After the first the level is written g, in the torque the rate \dot z: as papers print them.
    """
    import sympy

    algebra = carriers.build_symbol_carrier()
    equations = derive_equations(law)
    v, z, h, values = equations.velocity, equations.state, equations.period, equations.values
    g, rate, after, torque = sympy.symbols("g z_rate z_after tau", positive=True)
    short = replace(law, level=lambda _algebra, _velocity, _values: g)
    damping, viscous = law.damping(algebra, values)
    step, _ = compute_bristle_step(algebra, short, (v, h), z, values)
    rows = (
        (g, equations.level),
        (rate, compute_bristle_rate(algebra, short, v, z, values)),
        (torque, values[0] * z + damping * rate + viscous * v),
        (after, step),
    )
    names = {symbol: parameter.latex for symbol, parameter in zip(values, law.parameters, strict=True)}
    names |= {g: "g", rate: r"\dot z", torque: r"\tau_f", after: "z_+"}
    return tuple(f"{names[left]} = {sympy.latex(right, symbol_names=names)}" for left, right in rows)
