"""Friction with a memory: bristles that bend before they slip. Dahl's model and LuGre, one definition each.

Input: velocity, deflection z of the bristles and the parameters, in any carrier with products, quotients,
exponential, power and sign. Output: the rate of z, the torque, an exact step in time.

    dz/dt = v - sigma0 |v| / g(v) z
    tau_f = sigma0 z + sigma1 dz/dt + fV v                       positive against positive velocity
    Dahl:  g = fC, sigma1 = fV = 0
    LuGre: g = fC + (fS - fC) exp(-|v / vs|^gamma)
    v held over h:  z(h) = z_e + (z - z_e) exp(-sigma0 |v| h / g),  z_e = g sign(v) / sigma0

The step is the exact solution while the velocity is held, therefore stable however long it is: where explicit
methods need sigma0 |v| h / g < 2, it goes to the steady state. At v = 0 nothing moves.
Equations: Dahl, Aerospace Corporation report TOR-0158(3107-18)-1 (1968); Canudas de Wit, Olsson, Astrom and
Lischinsky, IEEE Transactions on Automatic Control 40 (1995) 419-425.

Supported: floats, arrays, mpmath, SymPy, CasADi, text of C: any carrier.
Not supported: Dahl's exponent other than one, sigma1 that depends on the velocity.
"""

import difflib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from symid.errors import Notice, UsageError
from symid.joint.friction_law import FrictionCarrier, LawParameter

__all__ = [
    "DYNAMIC_LAWS",
    "DynamicLaw",
    "check_dynamic_values",
    "find_bristle_rate",
    "find_bristle_step",
    "find_dynamic_torque",
    "find_largest_level",
    "find_steady_torque",
    "find_step_parts",
    "get_dynamic_law",
    "is_passive",
]

V = TypeVar("V")


@dataclass(frozen=True, slots=True, kw_only=True)
class DynamicLaw:
    """A friction model with the deflection of bristles as its state.

    Args:
        name: as it is asked for.
        parameters: in the order of the values that the functions take.
        level: (carrier, velocity, values) -> g, N m or N: what the bristles bear at this velocity, positive.
        damping: (carrier, values) -> sigma1 and fV.
        formula: in ASCII; source, smoothness, passivity: sentences.
    """

    name: str
    parameters: tuple[LawParameter, ...]
    level: Callable[[FrictionCarrier[V], V, Sequence[V]], V]
    damping: Callable[[FrictionCarrier[V], Sequence[V]], tuple[V, V]]
    formula: str
    source: str
    smoothness: str
    passivity: str

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the parameters."""
        return tuple(parameter.name for parameter in self.parameters)


def find_bristle_rate(
    algebra: FrictionCarrier[V], law: DynamicLaw, velocity: V, state: V, values: Sequence[V]
) -> V:
    """Return dz/dt = v - sigma0 |v| / g(v) z, rad/s or m/s.

    Args:
        algebra: the carrier.
        law: the model.
        velocity: v, rad/s or m/s.
        state: z, rad or m.
        values: parameters in the order of the law.
    """
    bent = algebra.mul(values[0], state)
    share = algebra.div(bent, law.level(algebra, velocity, values))
    return algebra.sub(velocity, algebra.mul(algebra.absolute(velocity), share))


def find_dynamic_torque(
    algebra: FrictionCarrier[V], law: DynamicLaw, velocity: V, state: V, values: Sequence[V]
) -> V:
    """Return tau_f = sigma0 z + sigma1 dz/dt + fV v, N m or N; arguments as in `find_bristle_rate`."""
    damping, viscous = law.damping(algebra, values)
    rate = find_bristle_rate(algebra, law, velocity, state, values)
    moving = algebra.add(algebra.mul(damping, rate), algebra.mul(viscous, velocity))
    return algebra.add(algebra.mul(values[0], state), moving)


def find_step_parts(
    algebra: FrictionCarrier[V], law: DynamicLaw, velocity: V, period: V, values: Sequence[V]
) -> tuple[V, V]:
    """Return exp(-sigma0 |v| h / g) and z_e = g sign(v) / sigma0: z(h) = z_e + (z - z_e) exp(...)."""
    level = law.level(algebra, velocity, values)
    way = algebra.mul(values[0], algebra.mul(algebra.absolute(velocity), period))
    decay = algebra.exp(algebra.sub(algebra.zero, algebra.div(way, level)))
    return decay, algebra.div(algebra.mul(level, algebra.sign(velocity)), values[0])


def find_bristle_step(
    algebra: FrictionCarrier[V], law: DynamicLaw, held: tuple[V, V], state: V, values: Sequence[V]
) -> tuple[V, V]:
    """Return z after a step, exact for a held velocity, and the torque at its end.

    Args:
        algebra: the carrier.
        law: the model.
        held: v during the step, rad/s or m/s, and how long: h >= 0, s.
        state: z before the step, rad or m.
        values: parameters in the order of the law.
    """
    velocity, period = held
    decay, rest = find_step_parts(algebra, law, velocity, period, values)
    after = algebra.add(rest, algebra.mul(algebra.sub(state, rest), decay))
    return after, find_dynamic_torque(algebra, law, velocity, after, values)


def find_steady_torque(algebra: FrictionCarrier[V], law: DynamicLaw, velocity: V, values: Sequence[V]) -> V:
    """Return g(v) sign(v) + fV v, N m or N: the torque after a long time at `velocity`."""
    _, viscous = law.damping(algebra, values)
    dry = algebra.mul(law.level(algebra, velocity, values), algebra.sign(velocity))
    return algebra.add(dry, algebra.mul(viscous, velocity))


def _find_levels(law: DynamicLaw, values: Sequence[float]) -> tuple[float, float]:
    """Return the least and the largest value that g takes."""
    named = dict(zip(law.names, values, strict=True))
    levels = [named[name] for name in ("fC", "fS") if name in named]
    return min(levels), max(levels)


def find_largest_level(law: DynamicLaw, values: Sequence[float]) -> float:
    """Return the largest g, N m or N; |z| that begins below it divided by sigma0 stays below."""
    return _find_levels(law, values)[1]


def is_passive(law: DynamicLaw, values: Sequence[float]) -> bool | None:
    """Return whether velocity to torque is passive with storage sigma0 z^2 / 2; None where it is not known.

    v tau_f - sigma0 z dz/dt = sigma0 a z^2 + (sigma1 + fV) v^2 - sigma1 a z v with a = sigma0 |v| / g, and
    |a z v| <= v^2 max g / min g: fV >= sigma1 (max g - min g) / min g suffices. Compare Barabanov and Ortega,
    IEEE Transactions on Automatic Control 45 (2000) 675-686.
    """
    named = dict(zip(law.names, values, strict=True))
    least, largest = _find_levels(law, values)
    damping, viscous = named.get("sigma1", 0.0), named.get("fV", 0.0)
    return True if viscous * least >= damping * (largest - least) else None


def check_dynamic_values(law: DynamicLaw, values: Sequence[float]) -> None:
    """Refuse values that are none of the law.

    Raises:
        UsageError: their number is wrong, or some are not finite or outside what the law allows.
    """
    if len(values) != len(law.parameters):
        text = f"friction {law.name!r} takes {', '.join(law.names)}: {len(values)} values were given"
        raise UsageError(Notice(code="joint.friction-values", text=text))
    notices = []
    for parameter, value in zip(law.parameters, values, strict=True):
        kept = value >= parameter.lower if parameter.lower_is_allowed else value > parameter.lower
        if not (math.isfinite(value) and kept and value <= parameter.upper):
            bound = "at least" if parameter.lower_is_allowed else "above"
            upper = f" and at most {parameter.upper:g}" if math.isfinite(parameter.upper) else ""
            text = (
                f"friction {law.name!r}: {parameter.name} ({parameter.meaning}) must be {bound} "
                f"{parameter.lower:g}{upper}, got {value:g}"
            )
            notices.append(Notice(code="joint.friction-values", text=text))
    if notices:
        raise UsageError(*notices)


def get_dynamic_law(name: str) -> DynamicLaw:
    """Return the model `name`.

    Raises:
        UsageError: there is none of this name; the message lists all and the nearest.
    """
    if name in DYNAMIC_LAWS:
        return DYNAMIC_LAWS[name]
    near = difflib.get_close_matches(name, DYNAMIC_LAWS, n=1)
    hint = f", did you mean {near[0]!r}? Known:" if near else "; known are"
    text = f"there is no dynamic friction {name!r}{hint} {', '.join(DYNAMIC_LAWS)}"
    raise UsageError(Notice(code="joint.no-dynamic-friction", text=text))


def _dahl_level(_algebra: FrictionCarrier[V], _velocity: V, values: Sequence[V]) -> V:
    return values[1]


def _dahl_damping(algebra: FrictionCarrier[V], _values: Sequence[V]) -> tuple[V, V]:
    return algebra.zero, algebra.zero


def _lugre_level(algebra: FrictionCarrier[V], velocity: V, values: Sequence[V]) -> V:
    _, _, coulomb, static, speed, exponent, _ = values
    ratio = algebra.div(algebra.absolute(velocity), speed)
    fall = algebra.exp(algebra.sub(algebra.zero, algebra.power(ratio, exponent)))
    return algebra.add(coulomb, algebra.mul(algebra.sub(static, coulomb), fall))


def _lugre_damping(_algebra: FrictionCarrier[V], values: Sequence[V]) -> tuple[V, V]:
    return values[1], values[6]


def _parameter(
    name: str,
    latex: str,
    units: tuple[str, str],
    meaning: str,
    *,
    lower: float = 0.0,
    upper: float = math.inf,
    positive: bool = True,
) -> LawParameter:
    return LawParameter(
        name=name,
        latex=latex,
        unit=units[0],
        unit_prismatic=units[1],
        meaning=meaning,
        lower=lower,
        upper=upper,
        start=None,
        lower_is_allowed=not positive,
    )


_TORQUE, _DAMPING = ("N m", "N"), ("N m s/rad", "N s/m")
_STIFFNESS = _parameter("sigma0", r"\sigma_0", ("N m/rad", "N/m"), "stiffness of the bristles")
_COULOMB = _parameter("fC", "f_C", _TORQUE, "Coulomb friction")

DYNAMIC_LAWS: dict[str, DynamicLaw] = {
    law.name: law
    for law in (
        DynamicLaw(
            name="dahl",
            parameters=(_STIFFNESS, _COULOMB),
            level=_dahl_level,
            damping=_dahl_damping,
            formula="dz/dt = v - sigma0 |v| / fC z, tau_f = sigma0 z",
            source="Dahl 1968, exponent one",
            smoothness="continuous in time; the slope of the torque over the position jumps at reversals",
            passivity="passive for all positive parameters; it follows the path, not the speed",
        ),
        DynamicLaw(
            name="lugre",
            parameters=(
                _STIFFNESS,
                _parameter("sigma1", r"\sigma_1", _DAMPING, "damping of the bristles", positive=False),
                _COULOMB,
                _parameter("fS", "f_S", _TORQUE, "static friction, the level of break-away"),
                _parameter("vs", "v_s", ("rad/s", "m/s"), "Stribeck velocity"),
                _parameter(
                    "gamma", r"\gamma", ("1", "1"), "Stribeck exponent", lower=0.5, upper=4.0, positive=False
                ),
                _parameter("fV", "f_V", _DAMPING, "viscous friction", positive=False),
            ),
            level=_lugre_level,
            damping=_lugre_damping,
            formula=(
                "dz/dt = v - sigma0 |v| / g(v) z, g = fC + (fS - fC) exp(-|v / vs|^gamma), "
                "tau_f = sigma0 z + sigma1 dz/dt + fV v"
            ),
            source="Canudas de Wit, Olsson, Astrom and Lischinsky 1995",
            smoothness="torque continuous in time where the velocity is",
            passivity="passive where fV >= sigma1 |fS - fC| / min(fC, fS); the state is bounded always",
        ),
    )
}
