"""The static friction laws by name.

Output: `FRICTION_LAWS`, and builders for laws with other exponents, orders, readings.

    get_law("stribeck"), get_law("stribeck-1.6"), get_law("improved-stribeck-h2-exponent"),
    get_law("position-dependent-1,2x100"), get_law("coulomb-viscous+offset")

Supported: laws without a memory. Not supported: temperature; laws with a state (`friction_dynamic`).
"""

import difflib
import math
import re
from collections.abc import Callable
from dataclasses import replace

from symid.errors import Notice, UsageError
from symid.joint import friction_columns as columns
from symid.joint import friction_sources as sources
from symid.joint.friction_builders import (
    DEFAULT_EXPONENT,
    are_resistive,
    build_asymmetric_stribeck,
    build_improved,
    build_law,
    build_load_dependent,
    build_makkar,
    build_polynomial,
    build_position_dependent,
    build_stribeck,
    with_offset,
    with_smoothing,
)
from symid.joint.friction_dynamic import DYNAMIC_LAWS
from symid.joint.friction_law import FrictionLaw

__all__ = [
    "FRICTION_LAWS",
    "build_asymmetric_stribeck",
    "build_improved",
    "build_load_dependent",
    "build_polynomial",
    "build_position_dependent",
    "build_stribeck",
    "get_law",
    "with_offset",
    "with_smoothing",
]


def _list_laws() -> tuple[FrictionLaw, ...]:
    return (
        *_list_plain(),
        replace(build_stribeck(exponent=1.0), name="tustin"),
        build_stribeck(),
        build_stribeck(exponent=None),
        build_law(
            "lorentzian",
            "Fv Fc Fs",
            "vs",
            "fC fS vs fV",
            sources.LORENTZIAN,
            find=columns.find_lorentzian,
            resistive=are_resistive,
        ),
        *(build_improved(reading=reading) for reading in ("H1", "H2", "H3", "H4")),
        build_improved(exponent=None),
        build_asymmetric_stribeck(),
        build_asymmetric_stribeck(bumps=2),
        build_polynomial(),
        build_law(
            "power-law",
            "Fc Fd",
            "delta",
            "fC fD delta",
            sources.POWER_LAW,
            find=columns.find_power_law,
            resistive=are_resistive,
        ),
        build_makkar(),
        build_load_dependent(),
        build_load_dependent(falls=True, exponent=DEFAULT_EXPONENT),
        build_position_dependent(),
        build_position_dependent(dry=False),
        build_stribeck(orders=(2, 3)),
    )


def _list_plain() -> tuple[FrictionLaw, ...]:
    """Return the laws that are piecewise linear in the velocity."""
    viscous = build_law(
        "coulomb-viscous",
        "Fv Fc",
        "",
        "fC fV",
        sources.COULOMB_VISCOUS,
        find=columns.find_coulomb_viscous,
        resistive=are_resistive,
    )
    return (
        build_law(
            "coulomb", "Fc", "", "fC", sources.COULOMB, find=columns.find_coulomb, resistive=are_resistive
        ),
        viscous,
        replace(with_offset(viscous), name="coulomb-viscous-offset"),
        build_law(
            "asymmetric",
            "Fvp Fcp Fvn Fcn",
            "",
            "fCp fVp fCn fVn",
            sources.ASYMMETRIC,
            find=columns.find_asymmetric,
            resistive=are_resistive,
        ),
    )


FRICTION_LAWS: dict[str, FrictionLaw] = {law.name: law for law in _list_laws()}

_LARGEST_EXPONENT = 10.0
"""As in robot files; beyond it a fall is a step that no log resolves, and its derivatives overflow."""
_NUMBER = r"\d+(?:\.\d+)?(?:e-?\d+)?"
_EXPONENT = rf"(?:-(?P<exponent>exponent|{_NUMBER}))?"
_WAVES = rf"(?P<orders>[1-9]\d*(?:,[1-9]\d*)*)(?:x(?P<gear>{_NUMBER}))?"


def _read_exponent(match: re.Match[str]) -> float | None:
    text = match["exponent"] or f"{DEFAULT_EXPONENT:g}"
    return None if text == "exponent" else float(text)


def _read_orders(match: re.Match[str]) -> tuple[int, ...]:
    return tuple(int(part) for part in match["orders"].split(","))


_PATTERNS: tuple[tuple[str, Callable[[re.Match[str]], FrictionLaw]], ...] = (
    (
        rf"stribeck{_EXPONENT}(?P<cubic>\+cubic)?",
        lambda m: build_stribeck(exponent=_read_exponent(m), orders=(2, 3) if m["cubic"] else ()),
    ),
    (
        rf"improved-stribeck(?:-(?P<reading>h[1-4]))?{_EXPONENT}",
        lambda m: build_improved(reading=(m["reading"] or "h1").upper(), exponent=_read_exponent(m)),
    ),
    (
        rf"asymmetric-stribeck(?P<both>-both)?{_EXPONENT}",
        lambda m: build_asymmetric_stribeck(exponent=_read_exponent(m), bumps=2 if m["both"] else 1),
    ),
    (
        rf"load-dependent-stribeck{_EXPONENT}",
        lambda m: build_load_dependent(exponent=_read_exponent(m), falls=True),
    ),
    (
        rf"position-(?P<what>dependent|torque)-{_WAVES}",
        lambda m: build_position_dependent(
            _read_orders(m), gear=float(m["gear"] or 1.0), dry=m["what"] == "dependent"
        ),
    ),
    (r"polynomial-(?P<orders>[2-9](?:,[2-9])*)", lambda m: build_polynomial(_read_orders(m))),
)


def _find_law(name: str) -> FrictionLaw | None:
    """Return the law of a name, None for one that is none or whose numbers are out of range."""
    if name in FRICTION_LAWS:
        return FRICTION_LAWS[name]
    if name.endswith("+offset"):
        law = _find_law(name.removesuffix("+offset"))
        return None if law is None or law.linear[-1].name == "offset" else with_offset(law)
    for pattern, build in _PATTERNS:
        match = re.fullmatch(pattern, name)
        if match:
            return None if _find_mistake(match) else build(match)
    return None


def _find_mistake(match: re.Match[str]) -> str:
    """Return what is wrong with the exponent, the gear or the orders of a name; nothing if all is well."""
    found = match.groupdict()
    exponent, gear, orders = (found.get(key) for key in ("exponent", "gear", "orders"))
    if exponent and exponent != "exponent" and not 0.0 < float(exponent) <= _LARGEST_EXPONENT:
        return f"its exponent must be above 0 and at most {_LARGEST_EXPONENT:g}"
    if gear and not 0.0 < float(gear) < math.inf:
        return "its gear ratio must be above 0 and finite"
    listed = (orders or "").split(",")
    return "" if len(set(listed)) == len(listed) else "each of its orders may stand once"


def _explain(name: str) -> str:
    """Return what is wrong with the name of a law that is none."""
    for pattern, _ in _PATTERNS:
        match = re.fullmatch(pattern, name.removesuffix("+offset"))
        mistake = _find_mistake(match) if match else ""
        if mistake:
            return f": {mistake}"
    if name in DYNAMIC_LAWS:
        return (
            ": it is one with a memory, which Python and C know (symid.joint.friction_dynamic, "
            "symid.friction.presliding), and not one of these"
        )
    near = difflib.get_close_matches(name, FRICTION_LAWS, n=3, cutoff=0.5)
    return f"; did you mean {' or '.join(near)}?" if near else ""


def get_law(name: str, *, smoothing: float = 0.0) -> FrictionLaw:
    """Return the law of a name; `smoothing` in rad/s or m/s replaces its sign by tanh(v / smoothing).

    Raises:
        UsageError: there is no such law, or its exponent, gear or orders are none that it may have.
    """
    law = _find_law(name.lower())
    if law is None:
        hint = _explain(name.lower())
        text = (
            f"no friction law is called {name!r}{hint}{'' if hint.endswith('?') else '.'} "
            f"There are {', '.join(FRICTION_LAWS)}; an exponent may "
            "follow (stribeck-1.6, stribeck-exponent), waves (position-dependent-1,2x100), and +offset"
        )
        raise UsageError(Notice(code="usage.unknown-friction-law", text=text))
    return with_smoothing(law, smoothing)
