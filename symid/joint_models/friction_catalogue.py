"""The static friction laws by name: their parameters, sources, builders and the catalogue.

Name, or what may be chosen about a law -> `FrictionLaw`, whose name says all of it.

    get_law("stribeck"), get_law("stribeck-1.6"), get_law("improved-stribeck-h2-exponent"),
    get_law("position-dependent-1,2x100"), get_law("coulomb-viscous+offset")

Any exponent, orders, reading of the improved law; offset and smoothing on top. Linear parameters begin with
a capital F, the same as papers print them with a small f; where both are one number, their bounds agree.

Not supported: temperature; laws with a state (`dynamic_friction`).
"""

import difflib
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import NamedTuple

from symid.errors import Notice, UsageError
from symid.joint_models import friction_columns as columns
from symid.joint_models.dynamic_friction import DYNAMIC_LAWS
from symid.joint_models.friction_law import FrictionLaw, LawParameter, build_parameter

_INFINITY = float("inf")
_TWINS = (
    ("V", "V", "viscous", "viscous friction", 0.0),
    ("C", "C", "level", "Coulomb friction", 0.0),
    ("Vp", "V^+", "viscous", "viscous friction, positive velocity", 0.0),
    ("Cp", "C^+", "level", "Coulomb friction, positive velocity", 0.0),
    ("Vn", "V^-", "viscous", "viscous friction, negative velocity", 0.0),
    ("Cn", "C^-", "level", "Coulomb friction, negative velocity", 0.0),
    ("P", "P", "level", "torque at zero velocity or added at all velocities, with its sign", -_INFINITY),
    ("D", r"\delta", "level", "friction that grows with a power of the velocity, at 1 rad/s or m/s", 0.0),
    ("L", "L", "number", "Coulomb friction per torque of the load", 0.0),
    ("M", "M", "level", "rise of dry friction before it falls again", 0.0),
)

LAW_PARAMETERS: dict[str, LawParameter] = {
    parameter.name: parameter
    for parameter in (
        *(build_parameter(f"f{end}", f"f_{tex}", kind, text, low) for end, tex, kind, text, low in _TWINS),
        *(
            build_parameter(f"F{end.lower()}", f"F_{tex}", kind, text, low)
            for end, tex, kind, text, low in _TWINS
        ),
        build_parameter("fS", "f_S", "level", "static friction, at the start of motion"),
        build_parameter("Fs", "F_s", "level", "static friction beyond Coulomb friction", -_INFINITY),
        build_parameter("fE", "f_E", "level", "static friction beyond Coulomb friction", -_INFINITY),
        build_parameter("fSp", "f_S^+", "level", "static friction, positive velocity"),
        build_parameter("fSn", "f_S^-", "level", "static friction, negative velocity"),
        build_parameter(
            "Fsp", "F_s^+", "level", "static beyond Coulomb friction, positive velocity", -_INFINITY
        ),
        build_parameter(
            "Fsn", "F_s^-", "level", "static beyond Coulomb friction, negative velocity", -_INFINITY
        ),
        build_parameter("fLS", "f_{LS}", "number", "static friction per torque of the load"),
        build_parameter(
            "Fls", "F_{ls}", "number", "static beyond Coulomb friction per torque of the load", -_INFINITY
        ),
        build_parameter("offset", r"\tau_0", "level", "constant torque: drive offset, asymmetry", -_INFINITY),
        build_parameter("vs", "v_s", "speed", "Stribeck velocity", start=0.05, allowed=False),
        build_parameter("gamma", r"\gamma", "number", "Stribeck exponent", 0.5, 4.0, 2.0),
        build_parameter(
            "dq0", r"\dot q_0", "speed", "edge of the zone around standstill", start=0.01, allowed=False
        ),
        build_parameter(
            "dqs", r"\dot q_0", "speed", "velocity at which friction changes its sign", start=0.0
        ),
        build_parameter("delta", r"\delta", "number", "exponent of viscous friction", 0.05, 3.0, 0.7),
        build_parameter(
            "g2", r"\gamma_2", "slope", "slope of the rise at standstill", start=100.0, allowed=False
        ),
        build_parameter("g3", r"\gamma_3", "slope", "slope of the fall after it", start=10.0, allowed=False),
        build_parameter("g5", r"\gamma_5", "slope", "slope of Coulomb friction", start=100.0, allowed=False),
    )
}


def build_power_parameters(order: int) -> tuple[LawParameter, LawParameter]:
    """Return the coefficient of |v|^(order - 1) v, linear and as printed."""
    linear, printed = (
        LawParameter(
            name=f"{letter}{end}{order}",
            latex=f"{letter}_{{V{order}}}",
            unit=f"N m s^{order}/rad^{order}",
            unit_prismatic=f"N s^{order}/m^{order}",
            meaning=f"friction that grows with the velocity to the power of {order}",
        )
        for letter, end in (("F", "v"), ("f", "V"))
    )
    return linear, printed


def build_wave_parameters(order: int) -> tuple[LawParameter, LawParameter]:
    """Return the coefficients of cosine and sine of `order` times the angle."""
    cosine, sine = (
        LawParameter(
            name=f"{letter}{order}",
            latex=f"{letter}_{{{order}}}",
            unit="N m",
            unit_prismatic="N",
            meaning=f"{wave} of {order} times the angle",
        )
        for letter, wave in (("A", "cosine"), ("B", "sine"))
    )
    return cosine, sine


_JUMP = "Jumps at zero velocity (sign), smooth elsewhere and in all parameters."
_NOT_NEGATIVE = "Never pushes where no coefficient is negative."
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
    if exponent == 1.0:
        return "Tustin, Journal of the IEE 94 (1947) 143-151"
    if exponent == 2.0:
        return _GAUSSIAN
    return "Bo, Pavelescu, Wear 82 (1982) 277-289"


DEFAULT_EXPONENT = 2.0
_LINEAR = {f"f{end}": f"F{end.lower()}" for end, *_ in _TWINS} | {"fE": "Fs"}
# Static levels are printed whole; their linear parameters are what they have beyond Coulomb friction.
_BEYOND = {"fS": ("Fc", "Fs"), "fSp": ("Fcp", "Fsp"), "fSn": ("Fcn", "Fsn"), "fLS": ("Fl", "Fls")}


def build_law(
    name: str,
    linear: str,
    shape: str,
    physical: str,
    *,
    find: Callable[..., tuple[object, ...]],
    formula: str,
    source: str,
    smoothness: str = _JUMP,
    passivity: str = _NOT_NEGATIVE,
    resistive: Callable[[Mapping[str, float]], bool] | None = None,
    inputs: tuple[str, ...] = ("velocity",),
    further: tuple[tuple[LawParameter, LawParameter], ...] = (),
) -> FrictionLaw:
    """Return a law from names of parameters, `further` linear ones behind them (linear, printed)."""
    names = [*linear.split(), *(own.name for own, _ in further), *shape.split()]
    of_further = {printed.name: own.name for own, printed in further}
    printed_names = [*physical.split(), *of_further]

    def find_row(printed: str) -> tuple[int, ...]:
        parts = _BEYOND.get(printed) or (of_further.get(printed) or _LINEAR.get(printed, printed),)
        return tuple(int(entry in parts) for entry in names)

    return FrictionLaw(
        name=name,
        linear=(*(LAW_PARAMETERS[entry] for entry in linear.split()), *(own for own, _ in further)),
        shape=tuple(LAW_PARAMETERS[entry] for entry in shape.split()),
        inputs=inputs,
        columns=find,
        physical=(
            *(LAW_PARAMETERS[entry] for entry in physical.split()),
            *(printed for _, printed in further),
        ),
        mixing=tuple(find_row(entry) for entry in printed_names),
        formula=formula,
        source=source,
        smoothness=smoothness,
        passivity=passivity,
        resistive=resistive or are_resistive,
    )


def are_resistive(values: Mapping[str, float], *, signed: tuple[str, ...] = ()) -> bool:
    """Return whether no coefficient is negative and those of either sign are zero."""
    coefficients = {name: value for name, value in values.items() if name.startswith("f")}
    return all(value == 0.0 if name in signed else value >= 0.0 for name, value in coefficients.items())


def _is_makkar_resistive(values: Mapping[str, float]) -> bool:
    return are_resistive(values) and values["g2"] >= values["g3"] > 0.0 and values["g5"] > 0.0


def _is_wave_resistive(values: Mapping[str, float], *, dry: bool) -> bool:
    waves = sum(abs(value) for name, value in values.items() if name[0] in "AB")
    return values["fV"] >= 0.0 and values["fC"] >= (waves if dry or not waves else float("inf"))


def _is_offset_resistive(
    values: Mapping[str, float], *, resistive: Callable[[Mapping[str, float]], bool]
) -> bool:
    return values["offset"] == 0.0 and resistive(values)


def _name_exponent(name: str, exponent: float | None) -> str:
    if exponent is None:
        return f"{name}-exponent"
    return name if exponent == DEFAULT_EXPONENT else f"{name}-{exponent:.12g}"


def build_stribeck(*, exponent: float | None = DEFAULT_EXPONENT, orders: tuple[int, ...] = ()) -> FrictionLaw:
    """Return Stribeck's curve with a fixed exponent or, for None, a free one.

    Args:
        exponent: gamma > 0.
        orders: of further viscous terms |v|^(k-1) v, k >= 2, each once.
    """
    free = " gamma" if exponent is None else ""
    name = _name_exponent("stribeck", exponent) + ("+cubic" if orders else "")
    return build_law(
        name,
        "Fv Fc Fs",
        f"vs{free}",
        f"fC fS vs{free} fV",
        find=partial(columns.compute_stribeck_columns, exponent=exponent, orders=orders),
        formula=f"[fC + (fS - fC) {_write_fall(exponent)}] sign(dq) + fV dq{_write_further(orders)}",
        source=_get_stribeck_source(exponent),
        further=tuple(map(build_power_parameters, orders)),
    )


def build_polynomial(orders: tuple[int, ...] = (2, 3)) -> FrictionLaw:
    """Return Coulomb friction and a polynomial viscous one with `orders` beyond the first."""
    return build_law(
        "cubic" if orders == (2, 3) else f"polynomial-{','.join(map(str, orders))}",
        "Fv Fc",
        "",
        "fC fV",
        find=partial(columns.compute_polynomial_columns, orders=orders),
        formula=f"fC sign(dq) + fV dq{_write_further(orders)}",
        source="a polynomial of the velocity, as in Simoni, Beschi, Visioli, Legnani, Robotica 35 (2017)",
        further=tuple(map(build_power_parameters, orders)),
    )


class _Reading(NamedTuple):
    """What a reading of the improved law is called, its edge, and its sentences."""

    suffix: str
    edge: str
    formula: str
    smoothness: str
    passivity: str


_ZONE = "Continuous in the velocity, with knees at +-dq0; smooth in vs, gamma, piecewise in dq0."
_UNBIASED = "Pushes near standstill unless fP is zero."
_READINGS = {
    "H1": _Reading(
        "",
        " dq0",
        "fP + g(dq) sign(dq) for |dq| >= dq0, fP + g(dq0) dq / dq0 within",
        _ZONE,
        _UNBIASED,
    ),
    "H2": _Reading(
        "-h2",
        " dq0",
        "g(dq) sign(dq) for |dq| >= dq0, straight lines from fP at rest to +-g(dq0) within",
        _ZONE,
        _UNBIASED,
    ),
    "H3": _Reading(
        "-h3",
        "",
        "fP + g(dq) sign(dq)",
        _JUMP,
        "Pushes in one direction where |fP| is more than the friction.",
    ),
    "H4": _Reading(
        "-h4",
        " dqs",
        "fP + g(dq - dq0) sign(dq - dq0)",
        "Jumps at dq0, in the velocity and in dq0; smooth elsewhere.",
        "Pushes between standstill and dq0.",
    ),
}


def build_improved(*, reading: str = "H1", exponent: float | None = DEFAULT_EXPONENT) -> FrictionLaw:
    """Return a reading of the improved Stribeck law of Zhang, Hu and Zou (2021), whose formula is not known.

    Args:
        reading: H1: bias, straight line within |v| < dq0. H2: the line from the bias at rest to the curve.
            H3: bias, no zone (and no dq0). H4: the curve's origin at dq0.
        exponent: gamma, None for a free one.

    Raises:
        KeyError: there is no such reading.
    """
    free = " gamma" if exponent is None else ""
    chosen = _READINGS[reading]
    if reading in {"H1", "H2"}:
        find = partial(columns.compute_improved_columns, exponent=exponent, bias_everywhere=reading == "H1")
    else:
        find = partial(columns.compute_shifted_columns, exponent=exponent, shifted=reading == "H4")
    curve = f"g(v) = fC + (fS - fC) exp(-{_write_power('(|v| / vs)', exponent)}) + fV |v|"
    return build_law(
        _name_exponent(f"improved-stribeck{chosen.suffix}", exponent),
        "Fv Fc Fs Fp",
        f"vs{chosen.edge}{free}",
        f"fC fS vs{free} fV fP{chosen.edge}",
        find=find,
        formula=f"{chosen.formula}; {curve}",
        source=f"reading {reading}, {_ZHANG}",
        smoothness=chosen.smoothness,
        passivity=chosen.passivity,
        resistive=partial(_is_improved_resistive, shifted=reading == "H4"),
    )


def _is_improved_resistive(values: Mapping[str, float], *, shifted: bool) -> bool:
    return are_resistive(values, signed=("fP",)) and not (shifted and values["dqs"] != 0.0)


def build_asymmetric_stribeck(*, exponent: float | None = DEFAULT_EXPONENT, bumps: int = 1) -> FrictionLaw:
    """Return Stribeck friction by direction, the fall the same in both (1 bump) or not (2)."""
    free = " gamma" if exponent is None else ""
    one, fall = bumps == 1, _write_fall(exponent)
    parts = ("fE", "fE") if one else ("(fSp - fCp)", "(fSn - fCn)")
    return build_law(
        _name_exponent("asymmetric-stribeck" if one else "asymmetric-stribeck-both", exponent),
        "Fvp Fcp Fvn Fcn Fs" if one else "Fvp Fcp Fsp Fvn Fcn Fsn",
        f"vs{free}",
        f"fCp fVp fCn fVn fE vs{free}" if one else f"fCp fSp fVp fCn fSn fVn vs{free}",
        find=partial(columns.compute_asymmetric_stribeck_columns, exponent=exponent, bumps=bumps),
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
        "Fv Fc Fl Fs Fls" if falls else "Fv Fc Fl",
        f"vs{free}" if falls else "",
        f"fC fS vs{free} fV fL fLS" if falls else "fC fV fL",
        find=partial(columns.compute_load_dependent_columns, exponent=exponent, falls=falls),
        formula=formula,
        source=source,
        inputs=("velocity", "load"),
    )


def build_position_dependent(
    orders: tuple[int, ...] = (1, 2), *, gear: float = 1.0, dry: bool = True
) -> FrictionLaw:
    """Return Coulomb and viscous friction with waves of the motor's angle.

    Args:
        orders: waves a turn of the motor.
        gear: turns of the motor a turn of the joint.
        dry: whether the waves change dry friction (sign with the direction), or are a torque of the position.
    """
    ending = "" if orders == (1, 2) and gear == 1.0 else f"-{','.join(map(str, orders))}"
    ending += "" if gear == 1.0 else f"x{gear:.12g}"
    waves = [wave for order in orders for wave in build_wave_parameters(order)]
    series = "sum_k [Ak cos(k theta) + Bk sin(k theta)]"
    formula = f"fC sign(dq) + fV dq + {series}, theta: angle of the motor"
    passivity = "The waves push and brake in turn, and do no work over a turn; the rest never pushes."
    if dry:
        formula = f"[fC + {series}] sign(dq) + fV dq, theta: angle of the motor"
        passivity = "Never pushes where fC is at least the sum of all |Ak|, |Bk|, and fV is not negative."
    return build_law(
        f"position-{'dependent' if dry else 'torque'}{ending}",
        "Fv Fc",
        "",
        "fC fV",
        find=partial(columns.compute_position_dependent_columns, orders=orders, gear=gear, dry=dry),
        formula=formula,
        source="Fourier series of the motor's angle",
        passivity=passivity,
        resistive=partial(_is_wave_resistive, dry=dry),
        inputs=("velocity", "position"),
        further=tuple((wave, wave) for wave in waves),
    )


def with_offset(law: FrictionLaw) -> FrictionLaw:
    """Return a law with a constant torque as its last linear parameter, named `offset`."""
    offset = LAW_PARAMETERS["offset"]
    count = len(law.linear)
    mixing = [(*row[:count], 0, *row[count:]) for row in law.mixing]
    mixing.append(tuple(int(k == count) for k in range(count + 1 + len(law.shape))))
    return replace(
        law,
        name=f"{law.name}+offset",
        linear=(*law.linear, offset),
        physical=(*law.physical, offset),
        mixing=tuple(mixing),
        columns=partial(columns.append_constant, columns=law.columns),
        formula=f"{law.formula} + offset",
        passivity="Pushes wherever the offset is more than what brakes; without offset: " + law.passivity,
        resistive=partial(_is_offset_resistive, resistive=law.resistive),
    )


def with_smoothing(law: FrictionLaw, speed: float) -> FrictionLaw:
    """Return a law with tanh(v / speed) in place of the sign; speed in rad/s or m/s, 0 for the sign."""
    if speed == 0.0:
        return law
    return replace(
        law,
        columns=partial(columns.smooth_columns, columns=law.columns, speed=speed),
        smoothing=speed,
        smoothness=f"Dry friction changes its sign over {speed:g} rad/s or m/s as tanh does.",
    )


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
            find=columns.compute_lorentzian_columns,
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
            "Fc Fd",
            "delta",
            "fC fD delta",
            find=columns.compute_power_law_columns,
            formula="fC sign(dq) + fD |dq|^delta sign(dq)",
            source="a power of the velocity, as in Wolf, Iskandar, ICRA 2018",
            smoothness="Jumps at zero velocity, where for delta < 1 its slope grows without bound; "
            "smooth elsewhere.",
        ),
        build_law(
            "makkar",
            "Fm Fc Fv",
            "g2 g3 g5",
            "fM g2 g3 fC g5 fV",
            find=columns.compute_makkar_columns,
            formula="fM [tanh(g2 dq) - tanh(g3 dq)] + fC tanh(g5 dq) + fV dq",
            source="Makkar, Dixon, Sawyer, Hu, AIM 2005, 600-605",
            smoothness="Smooth in the velocity and in all parameters.",
            passivity="Never pushes where no coefficient is negative and g2 >= g3.",
            resistive=_is_makkar_resistive,
        ),
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
        find=columns.compute_coulomb_viscous_columns,
        formula="fC sign(dq) + fV dq",
        source="Coulomb (1785), Reynolds (1886)",
    )
    return (
        build_law(
            "coulomb",
            "Fc",
            "",
            "fC",
            find=columns.compute_coulomb_columns,
            formula="fC sign(dq)",
            source="Coulomb (1785)",
        ),
        viscous,
        replace(with_offset(viscous), name="coulomb-viscous-offset"),
        build_law(
            "asymmetric",
            "Fvp Fcp Fvn Fcn",
            "",
            "fCp fVp fCn fVn",
            find=columns.compute_asymmetric_columns,
            formula="fCp + fVp dq for dq > 0, -fCn + fVn dq for dq < 0",
            source="Janot, Gautier, Brunot, data set and reference models of EMPS (2019)",
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


def _match_law(name: str) -> FrictionLaw | None:
    """Return the law of a name, None for one that is none or whose numbers are out of range."""
    if name in FRICTION_LAWS:
        return FRICTION_LAWS[name]
    if name.endswith("+offset"):
        law = _match_law(name.removesuffix("+offset"))
        return None if law is None or law.linear[-1].name == "offset" else with_offset(law)
    for pattern, build in _PATTERNS:
        match = re.fullmatch(pattern, name)
        if match:
            return None if _describe_mistake(match) else build(match)
    return None


def _describe_mistake(match: re.Match[str]) -> str:
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
        mistake = _describe_mistake(match) if match else ""
        if mistake:
            return f": {mistake}"
    if name in DYNAMIC_LAWS:
        return (
            ": it is one with a memory, which Python and C know (symid.joint_models.get_dynamic_law, "
            "symid.identification.friction.fit_presliding), and not one of these"
        )
    near = difflib.get_close_matches(name, FRICTION_LAWS, n=3, cutoff=0.5)
    return f"; did you mean {' or '.join(near)}?" if near else ""


def get_law(name: str, *, smoothing: float = 0.0) -> FrictionLaw:
    """Return the law of a name; `smoothing` in rad/s or m/s replaces its sign by tanh(v / smoothing).

    Raises:
        UsageError: there is no such law, or its exponent, gear or orders are none that it may have.
    """
    law = _match_law(name.lower())
    if law is None:
        hint = _explain(name.lower())
        text = (
            f"no friction law is called {name!r}{hint}{'' if hint.endswith('?') else '.'} "
            f"There are {', '.join(FRICTION_LAWS)}; an exponent may "
            "follow (stribeck-1.6, stribeck-exponent), waves (position-dependent-1,2x100), and +offset"
        )
        raise UsageError(Notice(code="usage.unknown-friction-law", text=text))
    return with_smoothing(law, smoothing)
