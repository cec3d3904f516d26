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
attraction of Maxwell-slip elements that takes time.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

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
    level, after = values["Fc"], list[V]()
    if "Fe" in values:
        ratio = algebra.div(algebra.absolute(velocity), values["vs"])
        fall = algebra.exp(algebra.sub(algebra.zero, algebra.power(ratio, values["gamma"])))
        level = algebra.add(level, algebra.mul(values["Fe"], fall))
    # g(v) > 0, the largest torque of bristles and elements.
    level = algebra.maximum(level, algebra.scale(_LEAST_LEVEL, algebra.one))
    if "sigma0" in values:
        # sigma0 z + sigma1 dz/dt.
        stiffness = values["sigma0"]
        turn = algebra.div(algebra.mul(stiffness, algebra.absolute(way)), level)
        decay = algebra.exp(algebra.sub(algebra.zero, turn))
        rest = algebra.div(algebra.mul(level, algebra.sign(way)), stiffness)
        after.append(algebra.add(rest, algebra.mul(algebra.sub(states[0], rest), decay)))
        torque = algebra.mul(stiffness, after[0])
        if "sigma1" in values:
            share = algebra.mul(algebra.absolute(velocity), algebra.div(torque, level))
            torque = algebra.add(torque, algebra.mul(values["sigma1"], algebra.sub(velocity, share)))
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
