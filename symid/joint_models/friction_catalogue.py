"""The static friction laws by name: their parameters, sources, builders and the catalogue.

Name, or the options of a law -> `FrictionLaw`.

    get_law("stribeck"), get_law("stribeck-1.6"), get_law("improved-stribeck-h2-exponent"),
    get_law("position-dependent-1,2x100"), get_law("coulomb-viscous+offset")

Linear parameters begin with a capital F, the same as papers print them with a small f; where both are one
number, their bounds agree.

Supported: any exponent, orders, reading of the improved law; offset and smoothing on top; the names of
earlier robot files, as viscous_coulomb; laws with a state, whose columns are those of steady sliding.
Not supported: the state itself (`dynamic_friction`).
"""

import difflib
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import cache, partial
from typing import Any

import numpy as np

from symid.errors import Notice, UsageError
from symid.joint_models.carriers import build_float_carrier, smooth
from symid.joint_models.friction_law import (
    NO_FRICTION,
    REFERENCE_TEMPERATURE,
    FrictionLaw,
    FrictionValues,
    LawParameter,
    Wave,
    build_parameter,
    compute_improved_columns,
    compute_lorentzian_columns,
    compute_makkar_columns,
    compute_named_columns,
    compute_position_dependent_columns,
    compute_shifted_columns,
)

_ANY = -math.inf
# Parameters that laws have as linear ones, F.., and as printed ones, f..; and their lower bounds.
_TWINS: tuple[tuple[Any, ...], ...] = (
    ("V", "V", "viscous", "viscous friction", 0.0),
    ("C", "C", "level", "Coulomb friction", 0.0),
    ("Vp", "V^+", "viscous", "viscous friction, positive velocity", 0.0),
    ("Cp", "C^+", "level", "Coulomb friction, positive velocity", 0.0),
    ("Vn", "V^-", "viscous", "viscous friction, negative velocity", 0.0),
    ("Cn", "C^-", "level", "Coulomb friction, negative velocity", 0.0),
    ("P", "P", "level", "torque at zero velocity or added at all velocities, with its sign", _ANY),
    ("D", r"\delta", "level", "friction that grows with a power of the velocity, at 1 rad/s or m/s", 0.0),
    ("L", "L", "number", "Coulomb friction per torque of the load", 0.0),
    ("M", "M", "level", "rise of dry friction before it falls again", 0.0),
    ("CT", "{CT}", "level per kelvin", "change of Coulomb friction with the temperature", _ANY),
    ("VT", "{VT}", "viscous per kelvin", "change of viscous friction with the temperature", _ANY),
    ("VL", "{VL}", "viscous", "viscous friction that warmth takes away, at 0 degC", 0.0),
)
_OTHERS: tuple[tuple[Any, ...], ...] = (
    ("fS", "f_S", "level", "static friction, at the start of motion"),
    ("Fe", "F_e", "level", "static friction beyond Coulomb friction", _ANY),
    ("fE", "f_E", "level", "static friction beyond Coulomb friction", _ANY),
    ("fSp", "f_S^+", "level", "static friction, positive velocity"),
    ("fSn", "f_S^-", "level", "static friction, negative velocity"),
    ("Fep", "F_e^+", "level", "static beyond Coulomb friction, positive velocity", _ANY),
    ("Fen", "F_e^-", "level", "static beyond Coulomb friction, negative velocity", _ANY),
    ("fLS", "f_{LS}", "number", "static friction per torque of the load"),
    ("Fle", "F_{le}", "number", "static beyond Coulomb friction per torque of the load", _ANY),
    ("offset", r"\tau_0", "level", "constant torque: drive offset, asymmetry", _ANY),
    ("gamma", r"\gamma", "number", "Stribeck exponent", 0.5, 4.0),
    ("dqs", r"\dot q_0", "speed", "velocity at which friction changes its sign"),
    ("delta", r"\delta", "number", "exponent of viscous friction", 0.05, 3.0),
)
_POSITIVE: tuple[tuple[Any, ...], ...] = (
    ("vs", "v_s", "speed", "Stribeck velocity"),
    ("dq0", r"\dot q_0", "speed", "edge of the zone around standstill"),
    ("g2", r"\gamma_2", "slope", "slope of the rise at standstill"),
    ("g3", r"\gamma_3", "slope", "slope of the fall after it"),
    ("g5", r"\gamma_5", "slope", "slope of Coulomb friction"),
    ("TV", "T_V", "kelvin", "temperature over which cold friction falls to 1/e"),
)

_positive = partial(build_parameter, allowed=False)

_PARAMETERS: dict[str, LawParameter] = {
    parameter.name: parameter
    for parameter in (
        *(build_parameter(f"f{end}", f"f_{tex}", *rest) for end, tex, *rest in _TWINS),
        *(build_parameter(f"F{end.lower()}", f"F_{tex}", *rest) for end, tex, *rest in _TWINS),
        *(build_parameter(*row) for row in _OTHERS),
        *(_positive(*row) for row in _POSITIVE),
    )
}

_BRISTLES = (
    _positive("sigma0", r"\sigma_0", "stiffness", "stiffness of the bristles"),
    build_parameter("sigma1", r"\sigma_1", "viscous", "damping of the bristles"),
)
"""What LuGre remembers with; Dahl has the first."""
_ELEMENTS = (
    _positive("stiffness", "s_k", "stiffness", "stiffness of each element"),
    _positive("share", "a_k", "number", "share of each element in dry friction; their sum is one", 0.0, 1.0),
)
"""The same of Maxwell-slip, a list each."""


def _build_power_parameters(order: int) -> tuple[LawParameter, LawParameter]:
    """Return the coefficient of |v|^(order - 1) v, linear and as printed."""
    units = (f"N m s^{order}/rad^{order}", f"N s^{order}/m^{order}")
    meaning = f"friction that grows with the velocity to the power of {order}"
    linear = LawParameter({2: "Fvq", 3: "Fvc"}.get(order, f"Fv{order}"), f"F_{{V{order}}}", *units, meaning)
    return linear, replace(linear, name=f"fV{order}", latex=f"f_{{V{order}}}")


_GAUSSIAN = "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083-1138"
_ZHANG = "after Zhang, Hu, Zou, J. Zhejiang Univ. (Eng. Sci.) 55 (2021) 801-809, whose formula is not known"


def _write_power(base: str, exponent: float | None) -> str:
    """Return a power, of gamma for None, without an exponent of one."""
    if exponent == 1.0:
        return base
    return f"{base}^{'gamma' if exponent is None else f'{exponent:g}'}"


def _write_fall(exponent: float | None) -> str:
    return f"exp(-{_write_power('|dq / vs|', exponent)})"


def _write_further(orders: tuple[int, ...]) -> str:
    return "".join(f" + fV{order} {_write_power('|dq|', order - 1)} dq" for order in orders)


def _get_stribeck_source(exponent: float | None) -> str:
    known = {1.0: "Tustin, Journal of the IEE 94 (1947) 143-151", 2.0: _GAUSSIAN}
    return known.get(exponent or 0.0, "Bo, Pavelescu, Wear 82 (1982) 277-289")


DEFAULT_EXPONENT = 2.0
_WARM = f"{REFERENCE_TEMPERATURE:g}"
_LINEAR = {f"f{end}": f"F{end.lower()}" for end, *_ in _TWINS} | {"fE": "Fe"}
# Static levels are printed whole; their linear parameters are what they have beyond Coulomb friction.
_BEYOND = {"fS": ("Fc", "Fe"), "fSp": ("Fcp", "Fep"), "fSn": ("Fcn", "Fen"), "fLS": ("Fl", "Fle")}
_PLAIN = ("Fv", "Fc", "Fvp", "Fcp", "Fvn", "Fcn", "Fp", "offset")
"""Parameters whose columns most laws make of v, |v|, sign(v) and one."""


def build_law(
    name: str,
    parameters: str,
    *,
    orders: tuple[int, ...] = (),
    added: Sequence[LawParameter] = (),
    **fields: Any,  # noqa: ANN401 - the other fields of the law
) -> FrictionLaw:
    """Return a law from names of parameters, "linear | shape | printed", powers by `orders` and others."""
    groups = (part.split() for part in parameters.split("|"))
    linear, shape, physical = (tuple(_PARAMETERS[name] for name in names) for names in groups)
    further = [*map(_build_power_parameters, orders), *((own, own) for own in added)]
    linear, physical = (*linear, *(own for own, _ in further)), (*physical, *(own for _, own in further))
    names = [entry.name for entry in (*linear, *shape)]
    # Of printed parameters, the sum of which others they are.
    parts = {printed.name: (own.name,) for own, printed in further} | _BEYOND
    sums = [parts.get(entry.name, (_LINEAR.get(entry.name, entry.name),)) for entry in physical]
    own = tuple(entry.name for entry in linear if entry.name not in _PLAIN)
    powers = dict(zip((own.name for own, _ in further), orders, strict=False))
    given: dict[str, Any] = {
        "names": names[: len(linear)],
        "exponent": fields.get("exponent"),
        "orders": powers,
    }
    return FrictionLaw(
        name=name,
        linear=linear,
        shape=shape,
        physical=physical,
        mixing=tuple(tuple(int(entry in whole) for entry in names) for whole in sums),
        **dict[str, Any](own=own, columns=partial(compute_named_columns, **given)) | fields,
    )


def _name_exponent(name: str, exponent: float | None) -> str:
    if exponent is None:
        return f"{name}-exponent"
    return name if exponent == DEFAULT_EXPONENT else f"{name}-{exponent:.12g}"


def build_stribeck(*, exponent: float | None = DEFAULT_EXPONENT, orders: tuple[int, ...] = ()) -> FrictionLaw:
    """Return Stribeck's curve, free exponent for None, and viscous terms |v|^(k-1) v of `orders` k >= 2."""
    free = " gamma" if exponent is None else ""
    name = _name_exponent("stribeck", exponent) + ("+cubic" if orders else "")
    return build_law(
        name,
        f"Fv Fc Fe | vs{free} | fC fS vs{free} fV",
        exponent=exponent,
        formula=f"[fC + (fS - fC) {_write_fall(exponent)}] sign(dq) + fV dq{_write_further(orders)}",
        source=_get_stribeck_source(exponent),
        orders=orders,
    )


def build_polynomial(orders: tuple[int, ...] = (2, 3)) -> FrictionLaw:
    """Return Coulomb friction and a polynomial viscous one with `orders` beyond the first."""
    return build_law(
        "cubic" if orders == (2, 3) else f"polynomial-{','.join(map(str, orders))}",
        "Fv Fc |  | fC fV",
        formula=f"fC sign(dq) + fV dq{_write_further(orders)}",
        source="a polynomial of the velocity, as in Simoni, Beschi, Visioli, Legnani, Robotica 35 (2017)",
        orders=orders,
    )


_ZONE = "Continuous in the velocity, with knees at +-dq0; smooth in vs, gamma, piecewise in dq0."
_UNBIASED = "Not dissipative near standstill unless fP is zero."
# Ending of the name, its further shape value, formula, smoothness, passivity.
_READINGS: dict[str, tuple[str, str, str, dict[str, Any]]] = {
    "H1": (
        "",
        " dq0",
        "fP + g(dq) sign(dq) for |dq| >= dq0, fP + g(dq0) dq / dq0 within",
        {"smoothness": _ZONE, "passivity": _UNBIASED, "own": ("Fc", "Fe")},
    ),
    "H2": (
        "-h2",
        " dq0",
        "g(dq) sign(dq) for |dq| >= dq0, straight lines from fP at rest to +-g(dq0) within",
        {"smoothness": _ZONE, "passivity": _UNBIASED, "own": ("Fc", "Fe", "Fp")},
    ),
    "H3": (
        "-h3",
        "",
        "fP + g(dq) sign(dq)",
        {"passivity": "Not dissipative in one direction where |fP| exceeds the friction."},
    ),
    "H4": (
        "-h4",
        " dqs",
        "fP + g(dq - dq0) sign(dq - dq0)",
        {
            "smoothness": "Jumps at dq0, in the velocity and in dq0; smooth elsewhere.",
            "passivity": "Not dissipative between standstill and dq0.",
            "own": ("Fc", "Fe"),
        },
    ),
}


def build_improved(*, reading: str = "H1", exponent: float | None = DEFAULT_EXPONENT) -> FrictionLaw:
    """Return a reading of the improved Stribeck law of Zhang, Hu and Zou (2021), whose formula is not known.

    H1: bias, straight line within |v| < dq0. H2: the line from the bias at rest to the curve. H3: bias, no
    zone (and no dq0). H4: the curve's origin at dq0. The exponent gamma is free for None.
    """
    free = " gamma" if exponent is None else ""
    ending, edge, formula, texts = _READINGS[reading]
    find = partial(compute_shifted_columns, exponent=exponent, shifted=reading == "H4")
    if reading in {"H1", "H2"}:
        find = partial(compute_improved_columns, exponent=exponent, bias_everywhere=reading == "H1")

    curve = f"g(v) = fC + (fS - fC) exp(-{_write_power('(|v| / vs)', exponent)}) + fV |v|"
    return build_law(
        _name_exponent(f"improved-stribeck{ending}", exponent),
        f"Fv Fc Fe Fp | vs{edge}{free} | fC fS vs{free} fV fP{edge}",
        columns=find,
        exponent=exponent,
        formula=f"{formula}; {curve}",
        source=f"reading {reading}, {_ZHANG}",
        **texts,
    )


def build_asymmetric_stribeck(*, exponent: float | None = DEFAULT_EXPONENT, bumps: int = 1) -> FrictionLaw:
    """Return Stribeck friction by direction, the fall the same in both (1 bump) or not (2)."""
    free = " gamma" if exponent is None else ""
    one, fall = bumps == 1, _write_fall(exponent)
    parts = ("fE", "fE") if one else ("(fSp - fCp)", "(fSn - fCn)")
    return build_law(
        _name_exponent("asymmetric-stribeck" if one else "asymmetric-stribeck-both", exponent),
        f"Fvp Fcp Fvn Fcn Fe | vs{free} | fCp fVp fCn fVn fE vs{free}"
        if one
        else f"Fvp Fcp Fep Fvn Fcn Fen | vs{free} | fCp fSp fVp fCn fSn fVn vs{free}",
        exponent=exponent,
        formula=f"fCp + {parts[0]} {fall} + fVp dq for dq > 0, -fCn - {parts[1]} {fall} + fVn dq for dq < 0",
        source=_get_stribeck_source(exponent) + "; by direction as EMPS",
    )


def build_load_dependent(*, exponent: float | None = None, falls: bool = False) -> FrictionLaw:
    """Return friction in proportion to the load; with `falls`, static friction too is more under load."""
    free = " gamma" if falls and exponent is None else ""
    fall = _write_fall(exponent)
    formula = "(fC + fL |load|) sign(dq) + fV dq"
    source = "Bittencourt, Gunnarsson, J. Dyn. Sys. Meas. Control 134 (2012) 051013"
    if falls:
        formula = f"[fC + fL |load| + (fS - fC + (fLS - fL) |load|) {fall}] sign(dq) + fV dq"
        source += ", without temperature"
    return build_law(
        _name_exponent("load-dependent-stribeck", exponent) if falls else "load-dependent",
        f"Fv Fc Fl Fe Fle | vs{free} | fC fS vs{free} fV fL fLS" if falls else "Fv Fc Fl | | fC fV fL",
        exponent=exponent if falls else None,
        formula=formula,
        source=source,
        inputs=("velocity", "load"),
    )


def build_position_dependent(
    orders: tuple[int, ...] = (1, 2), *, gear: float = 1.0, dry: bool = True
) -> FrictionLaw:
    """Return Coulomb and viscous friction with waves of the motor's angle, `orders` a turn of the motor.

    `gear` is turns of the motor a turn of the joint; waves change `dry` friction, or are a torque apart.
    """
    ending = "" if orders == (1, 2) and gear == 1.0 else f"-{','.join(map(str, orders))}"
    ending += "" if gear == 1.0 else f"x{gear:.12g}"
    waves = [
        LawParameter(
            f"{letter}{order}", f"{letter}_{{{order}}}", "N m", "N", f"{wave} of {order} times the angle"
        )
        for order in orders
        for letter, wave in (("A", "cosine"), ("B", "sine"))
    ]
    turns = Fraction(f"{gear:.12g}")
    series = "sum_k [Ak cos(k theta) + Bk sin(k theta)]"
    formula = f"fC sign(dq) + fV dq + {series}, theta: angle of the motor"
    passivity = "The waves do no work over a turn; the rest is dissipative where no coefficient is negative."
    if dry:
        formula = f"[fC + {series}] sign(dq) + fV dq, theta: angle of the motor"
        passivity = "Dissipative where fC is at least the sum of all |Ak|, |Bk|, and fV is not negative."
    return build_law(
        f"position-{'dependent' if dry else 'torque'}{ending}",
        "Fv Fc |  | fC fV",
        columns=partial(compute_position_dependent_columns, turns=[k * gear for k in orders], dry=dry),
        formula=formula,
        source="Fourier series of the motor's angle",
        passivity=passivity,
        inputs=("velocity", "position"),
        added=waves,
        waves=tuple(Wave(f"{letter}{k}", k * turns, letter == "B", dry) for k in orders for letter in "AB"),
    )


def with_offset(law: FrictionLaw) -> FrictionLaw:
    """Return a law with a constant torque as its last linear parameter, named `offset`."""
    offset, count = _PARAMETERS["offset"], len(law.linear)
    mixing = np.insert(np.array(law.mixing), count, 0, axis=1).tolist()
    mixing.append([int(k == count) for k in range(len(mixing[0]))])
    return replace(
        law,
        name=f"{law.name}+offset",
        linear=(*law.linear, offset),
        physical=(*law.physical, offset),
        mixing=tuple(map(tuple, mixing)),
        columns=lambda carrier, inputs, shape: (*law.columns(carrier, inputs, shape), carrier.one),
        formula=f"{law.formula} + offset",
        passivity="Not dissipative where the offset exceeds the friction; without offset: " + law.passivity,
    )


_COULOMB_VISCOUS = build_law(
    "coulomb-viscous",
    "Fv Fc |  | fC fV",
    formula="fC sign(dq) + fV dq",
    source="Coulomb (1785), Reynolds (1886)",
)

FRICTION_LAWS: dict[str, FrictionLaw] = {
    law.name: law
    for law in (
        build_law(
            "coulomb",
            "Fc |  | fC",
            formula="fC sign(dq)",
            source="Coulomb (1785)",
        ),
        _COULOMB_VISCOUS,
        replace(with_offset(_COULOMB_VISCOUS), name="coulomb-viscous-offset"),
        build_law(
            "asymmetric",
            "Fvp Fcp Fvn Fcn |  | fCp fVp fCn fVn",
            formula="fCp + fVp dq for dq > 0, -fCn + fVn dq for dq < 0",
            source="Janot, Gautier, Brunot, data set and reference models of EMPS (2019)",
        ),
        replace(build_stribeck(exponent=1.0), name="tustin"),
        build_stribeck(),
        build_stribeck(exponent=None),
        build_law(
            "lorentzian",
            "Fv Fc Fe | vs | fC fS vs fV",
            columns=compute_lorentzian_columns,
            formula="[fC + (fS - fC) / (1 + (dq / vs)^2)] sign(dq) + fV dq",
            source="Hess, Soom, Journal of Tribology 112 (1990) 147-152",
        ),
        *(build_improved(reading=reading) for reading in ("H1", "H2", "H3", "H4")),
        build_improved(exponent=None),
        build_asymmetric_stribeck(),
        build_asymmetric_stribeck(bumps=2),
        build_polynomial(),
        build_law(
            "power-law",
            "Fc Fd | delta | fC fD delta",
            formula="fC sign(dq) + fD |dq|^delta sign(dq)",
            source="a power of the velocity, as in Wolf, Iskandar, ICRA 2018",
            smoothness="Jumps at zero velocity, where for delta < 1 its slope grows without bound; "
            "smooth elsewhere.",
        ),
        build_law(
            "makkar",
            "Fm Fc Fv | g2 g3 g5 | fM g2 g3 fC g5 fV",
            columns=compute_makkar_columns,
            formula="fM [tanh(g2 dq) - tanh(g3 dq)] + fC tanh(g5 dq) + fV dq",
            source="Makkar, Dixon, Sawyer, Hu, AIM 2005, 600-605",
            smoothness="Smooth in the velocity and in all parameters.",
            passivity="Dissipative where no coefficient is negative and g2 >= g3.",
            own=("Fm", "Fc"),
        ),
        build_load_dependent(),
        build_load_dependent(falls=True, exponent=DEFAULT_EXPONENT),
        build_position_dependent(),
        build_position_dependent(dry=False),
        build_stribeck(orders=(2, 3)),
        build_law(
            "temperature",
            "Fv Fc Fvt Fct |  | fC fV fCT fVT",
            formula=f"[fC + fCT (T - {_WARM})] sign(dq) + [fV + fVT (T - {_WARM})] dq, T in degC",
            source="lines of the temperature; coefficients that change with it as in Simoni, Beschi, "
            "Visioli, Legnani, Robotica 35 (2017)",
            passivity="Dissipative at temperatures where both brackets are positive.",
            inputs=("velocity", "temperature"),
        ),
        build_law(
            "temperature-viscous",
            "Fv Fc Fvl | TV | fC fV fVL TV",
            formula="fC sign(dq) + [fV + fVL exp(-T / TV)] dq, T in degC",
            source="viscous part of Bittencourt, Gunnarsson, J. Dyn. Sys. Meas. Control 134 (2012) 051013",
            inputs=("velocity", "temperature"),
        ),
    )
}

_BENDS = "Continuous in time; while bristles bend it is a function of the displacement, not of the velocity."
_FOLLOWS = "Dissipative where no coefficient is negative; without fV independent of the speed."
_STEADY = "[fC + (fS - fC) exp(-|dq / vs|^gamma)] sign(dq) + fV dq"
_CLAMP = "Fk = clamp(stiffness_k zk, -+share_k g), dzk/dt = dq until it slips, tau_f = sum Fk + fV dq"

STATE_LAWS: dict[str, FrictionLaw] = {
    law.name: law
    for law in (
        replace(
            _COULOMB_VISCOUS,
            name="dahl",
            formula="sigma0 z + fV dq, dz/dt = dq - sigma0 |dq| / fC z; steady: fC sign(dq) + fV dq",
            source="Dahl 1968, exponent one, with viscous friction",
            smoothness=_BENDS,
            passivity=_FOLLOWS,
            memory=_BRISTLES[:1],
        ),
        replace(
            build_stribeck(exponent=None),
            name="lugre",
            formula="sigma0 z + sigma1 dz/dt + fV dq, dz/dt = dq - sigma0 |dq| / g z, "
            f"g = fC + (fS - fC) exp(-|dq / vs|^gamma); steady: {_STEADY}",
            source="Canudas de Wit, Olsson, Astrom and Lischinsky 1995",
            smoothness=_BENDS,
            passivity="Passive where fV >= sigma1 |fS - fC| / min(fC, fS); the state is bounded always.",
            memory=_BRISTLES,
        ),
        replace(
            _COULOMB_VISCOUS,
            name="maxwell-slip",
            formula=f"{_CLAMP}, g = fC; steady: fC sign(dq) + fV dq",
            source="Iwan, J. Applied Mechanics 33 (1966) 893-900, with viscous friction",
            smoothness=_BENDS,
            passivity=_FOLLOWS,
            memory=_ELEMENTS,
            elements=True,
        ),
        replace(
            build_stribeck(exponent=None),
            name="generalised-maxwell-slip",
            formula=f"{_CLAMP}, g = fC + (fS - fC) exp(-|dq / vs|^gamma); steady: {_STEADY}",
            source="Lampaert, Al-Bender, Swevers, IEEE Physics and Control (2003) 1170-1177, for an "
            "attraction without end: what slips is at its level",
            smoothness=_BENDS,
            passivity="Dissipative where no coefficient is negative and fS is positive.",
            memory=_ELEMENTS,
            elements=True,
        ),
    )
}
"""Laws with a state."""

_LARGEST_EXPONENT = 10.0
"""As in robot files; beyond it a fall is a step that no log resolves, and its derivatives overflow."""
_NUMBER = r"\d+(?:\.\d+)?(?:e-?\d+)?"
_EXPONENT = rf"(?:-(?P<exponent>exponent|{_NUMBER}))?"
_WAVES = rf"(?P<orders>[1-9]\d*(?:,[1-9]\d*)*)(?:x(?P<gear>{_NUMBER}))?"
_PATTERNS: dict[str, Callable[[Mapping[str, Any]], FrictionLaw]] = {
    rf"stribeck{_EXPONENT}(?P<cubic>\+cubic)?": lambda part: build_stribeck(
        exponent=part["exponent"], orders=(2, 3) if part["cubic"] else ()
    ),
    rf"improved-stribeck(?:-(?P<reading>h[1-4]))?{_EXPONENT}": lambda part: build_improved(
        exponent=part["exponent"], reading=(part["reading"] or "h1").upper()
    ),
    rf"asymmetric-stribeck(?P<both>-both)?{_EXPONENT}": lambda part: build_asymmetric_stribeck(
        exponent=part["exponent"], bumps=2 if part["both"] else 1
    ),
    rf"load-dependent-stribeck{_EXPONENT}": lambda part: build_load_dependent(
        exponent=part["exponent"], falls=True
    ),
    rf"position-(?P<what>dependent|torque)-{_WAVES}": lambda part: build_position_dependent(
        part["orders"], gear=part["gear"], dry=part["what"] == "dependent"
    ),
    r"polynomial-(?P<orders>[2-9](?:,[2-9])*)": lambda part: build_polynomial(part["orders"]),
}
_OTHER_NAMES = {
    "viscous-coulomb": "coulomb-viscous",
    "viscous-coulomb-offset": "coulomb-viscous-offset",
    "coulomb-viscous+offset": "coulomb-viscous-offset",
    "stribeck-offset": "stribeck+offset",
    "stribeck-cubic": "stribeck+cubic",
    "stribeck-1": "tustin",
    "stribeck-1+offset": "tustin+offset",
    "gms": "generalised-maxwell-slip",
}
"""Names of earlier robot files, with _ for -, and others that mean a law of the catalogue."""


def _match_law(name: str) -> tuple[FrictionLaw | None, str]:
    """Return the law of a name; None and why where there is none."""
    name = _OTHER_NAMES.get(name, name)
    if law := FRICTION_LAWS.get(name) or STATE_LAWS.get(name):
        return law, ""
    if name.endswith("+offset"):
        law, reason = _match_law(name.removesuffix("+offset"))
        if law is not None and law.linear[-1].name == "offset":
            return None, ": it has an offset already"
        return law and with_offset(law), reason
    for pattern, build in _PATTERNS.items():
        if match := re.fullmatch(pattern, name):
            part, mistake = _read_parts(match)
            return (None, f": {mistake}") if mistake else (build(part), "")
    near = difflib.get_close_matches(name, (*FRICTION_LAWS, *STATE_LAWS), n=3, cutoff=0.5)
    return None, f"; did you mean {' or '.join(near)}?" if near else ""


def _read_parts(match: re.Match[str]) -> tuple[dict[str, Any], str]:
    """Return the parts of a name, and what is wrong with exponent, gear or orders; nothing if all is well."""
    part: dict[str, Any] = {"exponent": "", "gear": "", "orders": ""} | match.groupdict("")
    searched, orders = part["exponent"] == "exponent", list(filter(None, part["orders"].split(",")))
    exponent = DEFAULT_EXPONENT if searched else float(part["exponent"] or DEFAULT_EXPONENT)
    gear = float(part["gear"] or 1.0)
    part |= {"exponent": None if searched else exponent, "gear": gear, "orders": tuple(map(int, orders))}
    if not 0.0 < exponent <= _LARGEST_EXPONENT:
        return part, f"its exponent must be above 0 and at most {_LARGEST_EXPONENT:g}"
    if not 0.0 < gear < math.inf:
        return part, "its gear ratio must be above 0 and finite"
    return part, "" if len(set(orders)) == len(orders) else "its orders must differ from each other"


@cache
def get_law(name: str, *, smoothing: float = 0.0) -> FrictionLaw:
    """Return the law of a name; `smoothing` in rad/s or m/s replaces its sign by tanh(v / smoothing).

    A UsageError where there is no such law, or its exponent, gear or orders are out of range.
    """
    law, reason = _match_law(name.lower().replace("_", "-"))
    if law is None:
        end = "" if reason.endswith("?") else "."
        text = f"unknown friction law {name!r}{reason}{end} Known laws: {list_known_laws()}"
        raise UsageError(Notice(code="usage.unknown-friction-law", text=text))
    if smoothing == 0.0:
        return law
    return replace(
        law,
        columns=lambda carrier, inputs, shape: law.columns(smooth(carrier, smoothing), inputs, shape),
        smoothing=smoothing,
        smoothness=f"Dry friction changes its sign over {smoothing:g} rad/s or m/s as tanh does.",
    )


def list_known_laws(*further: str) -> str:
    """Return a sentence's end with the names of all laws, and of what else is allowed."""
    return (
        f"{', '.join((*further, *FRICTION_LAWS))}; with a state: {', '.join(STATE_LAWS)}; an exponent may "
        "follow (stribeck-1.6, stribeck-exponent), waves (position-dependent-1,2x100), and +offset"
    )


def describe_unknown_law(name: str) -> str:
    """Return what is wrong with a law's name, with names like it; empty for a law."""
    law, reason = _match_law(name.lower().replace("_", "-"))
    return "" if law is not None else f"unknown friction law {name!r}{reason}"


_PARTS = {entry.name: entry for law in FRICTION_LAWS.values() for entry in law.linear}


def is_braking(name: str) -> bool:
    """Return whether a friction parameter, as Fv or Fv2, drives its joint where it is negative."""
    part = max((part for part in _PARTS if name.startswith(part)), key=len, default="")
    return bool(part) and _PARTS[part].lower == 0.0


def rename_law(name: str) -> str:
    """Return the name of the catalogue for a law's name, those of earlier files included, or `NO_FRICTION`.

    A UsageError where there is no such law.
    """
    return name if name == NO_FRICTION else get_law(name).name


def free_exponent(law: FrictionLaw) -> FrictionLaw | None:
    """Return the same law with a searched exponent gamma; None where its name has none, or states one."""
    head, plus, tail = law.name.partition("+")
    return _match_law(f"{head}-exponent{plus}{tail}")[0]


def fix_exponent(law: FrictionLaw, gamma: float) -> str:
    """Return the name of a law with a searched exponent, or that with gamma = 1 or 2 where it has this."""
    if "-exponent" not in law.name or gamma not in {1.0, DEFAULT_EXPONENT}:
        return law.name
    return get_law(law.name.replace("-exponent", "" if gamma == DEFAULT_EXPONENT else "-1")).name


def has_sign(law: FrictionLaw) -> bool:
    """Return whether a law takes the sign of the velocity, which smoothing replaces."""
    taken: list[float] = []

    def take(value: float) -> float:
        taken.append(value)
        return 1.0

    carrier = replace(build_float_carrier(), sign=take)
    law.columns(carrier, dict.fromkeys(law.inputs, 1.0), [1.0] * len(law.shape))
    return bool(taken)


def get_friction_law(friction: FrictionValues) -> FrictionLaw | None:
    """Return the law of a joint's friction with its smoothing; None for no friction."""
    return None if friction.law == NO_FRICTION else get_law(friction.law, smoothing=friction.smoothing)


def list_value_names(friction: FrictionValues) -> tuple[str, ...]:
    """Return the names of the linear parameters of a joint's friction."""
    law = get_friction_law(friction)
    return tuple(entry.name for entry in law.linear) if law else ()


def list_shape_names(friction: FrictionValues) -> tuple[str, ...]:
    """Return the names of the shape values of a joint's friction."""
    law = get_friction_law(friction)
    return tuple(entry.name for entry in law.shape) if law else ()


def name_values(friction: FrictionValues) -> dict[str, float]:
    """Return the linear values of a joint's friction by name; none where they are unknown."""
    return dict(zip(list_value_names(friction), friction.values, strict=True)) if friction.values else {}


def name_shape(friction: FrictionValues) -> dict[str, float]:
    """Return the shape values of a joint's friction by name; none where they are unknown."""
    return dict(zip(list_shape_names(friction), friction.shape, strict=True)) if friction.shape else {}
