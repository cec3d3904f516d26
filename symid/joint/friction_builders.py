"""Builders of static friction laws: any exponent, orders, reading; offset and smoothing on top.

Input: what may be chosen about a law. Output: `FrictionLaw`, whose name says all of it.

Supported: laws without a memory. Not supported: temperature.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

from symid.joint import friction_columns as columns
from symid.joint import friction_sources as sources
from symid.joint.friction_law import FrictionLaw, LawParameter
from symid.joint.friction_parameters import PARAMETERS, build_power, build_waves

__all__ = [
    "DEFAULT_EXPONENT",
    "are_resistive",
    "build_asymmetric_stribeck",
    "build_improved",
    "build_law",
    "build_load_dependent",
    "build_makkar",
    "build_polynomial",
    "build_position_dependent",
    "build_stribeck",
    "with_offset",
    "with_smoothing",
]

DEFAULT_EXPONENT = 2.0
_LINEAR = {"fV": "Fv", "fC": "Fc", "fP": "Fp", "fD": "Fd", "fL": "Fl", "fM": "Fm", "fE": "Fs"}
_LINEAR |= {"fVp": "Fvp", "fCp": "Fcp", "fVn": "Fvn", "fCn": "Fcn"}
# Static levels are printed whole; their linear parameters are what they have beyond Coulomb friction.
_BEYOND = {"fS": ("Fc", "Fs"), "fSp": ("Fcp", "Fsp"), "fSn": ("Fcn", "Fsn"), "fLS": ("Fl", "Fls")}


def build_law(
    name: str,
    linear: str,
    shape: str,
    physical: str,
    texts: sources.LawTexts,
    *,
    find: Callable[..., tuple[object, ...]],
    resistive: Callable[[Mapping[str, float]], bool],
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
        linear=(*(PARAMETERS[entry] for entry in linear.split()), *(own for own, _ in further)),
        shape=tuple(PARAMETERS[entry] for entry in shape.split()),
        inputs=inputs,
        columns=find,
        physical=(*(PARAMETERS[entry] for entry in physical.split()), *(printed for _, printed in further)),
        mixing=tuple(find_row(entry) for entry in printed_names),
        formula=texts.formula,
        source=texts.source,
        smoothness=texts.smoothness,
        passivity=texts.passivity,
        resistive=resistive,
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
        sources.describe_stribeck(exponent, orders),
        find=partial(columns.find_stribeck_law, exponent=exponent, orders=orders),
        resistive=are_resistive,
        further=tuple(map(build_power, orders)),
    )


def build_polynomial(orders: tuple[int, ...] = (2, 3)) -> FrictionLaw:
    """Return Coulomb friction and a polynomial viscous one with `orders` beyond the first."""
    return build_law(
        "cubic" if orders == (2, 3) else f"polynomial-{','.join(map(str, orders))}",
        "Fv Fc",
        "",
        "fC fV",
        sources.describe_polynomial(orders),
        find=partial(columns.find_polynomial, orders=orders),
        resistive=are_resistive,
        further=tuple(map(build_power, orders)),
    )


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
    suffix = {"H1": "", "H2": "-h2", "H3": "-h3", "H4": "-h4"}[reading]
    edge = {"H1": " dq0", "H2": " dq0", "H3": "", "H4": " dqs"}[reading]
    if reading in {"H1", "H2"}:
        find = partial(columns.find_improved, exponent=exponent, bias_everywhere=reading == "H1")
    else:
        find = partial(columns.find_shifted, exponent=exponent, shifted=reading == "H4")
    return build_law(
        _name_exponent(f"improved-stribeck{suffix}", exponent),
        "Fv Fc Fs Fp",
        f"vs{edge}{free}",
        f"fC fS vs{free} fV fP{edge}",
        sources.describe_improved(reading, exponent),
        find=find,
        resistive=partial(_is_improved_resistive, shifted=reading == "H4"),
    )


def _is_improved_resistive(values: Mapping[str, float], *, shifted: bool) -> bool:
    return are_resistive(values, signed=("fP",)) and not (shifted and values["dqs"] != 0.0)


def build_asymmetric_stribeck(*, exponent: float | None = DEFAULT_EXPONENT, bumps: int = 1) -> FrictionLaw:
    """Return Stribeck friction by direction, the fall the same in both (1 bump) or not (2)."""
    free = " gamma" if exponent is None else ""
    one = bumps == 1
    return build_law(
        _name_exponent("asymmetric-stribeck" if one else "asymmetric-stribeck-both", exponent),
        "Fvp Fcp Fvn Fcn Fs" if one else "Fvp Fcp Fsp Fvn Fcn Fsn",
        f"vs{free}",
        f"fCp fVp fCn fVn fE vs{free}" if one else f"fCp fSp fVp fCn fSn fVn vs{free}",
        sources.describe_asymmetric_stribeck(exponent, bumps),
        find=partial(columns.find_asymmetric_stribeck, exponent=exponent, bumps=bumps),
        resistive=are_resistive,
    )


def build_makkar() -> FrictionLaw:
    """Return the law of Makkar, smooth everywhere."""
    return build_law(
        "makkar",
        "Fm Fc Fv",
        "g2 g3 g5",
        "fM g2 g3 fC g5 fV",
        sources.MAKKAR,
        find=columns.find_makkar,
        resistive=_is_makkar_resistive,
    )


def build_load_dependent(*, exponent: float | None = None, falls: bool = False) -> FrictionLaw:
    """Return friction in proportion to the load; with `falls`, static friction too is more under load."""
    free = " gamma" if falls and exponent is None else ""
    return build_law(
        _name_exponent("load-dependent-stribeck", exponent) if falls else "load-dependent",
        "Fv Fc Fl Fs Fls" if falls else "Fv Fc Fl",
        f"vs{free}" if falls else "",
        f"fC fS vs{free} fV fL fLS" if falls else "fC fV fL",
        sources.describe_load_dependent(exponent, falls=falls),
        find=partial(columns.find_load_dependent, exponent=exponent, falls=falls),
        resistive=are_resistive,
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
    waves = [wave for order in orders for wave in build_waves(order)]
    return build_law(
        f"position-{'dependent' if dry else 'torque'}{ending}",
        "Fv Fc",
        "",
        "fC fV",
        sources.describe_position_dependent(dry=dry),
        find=partial(columns.find_position_dependent, orders=orders, gear=gear, dry=dry),
        resistive=partial(_is_wave_resistive, dry=dry),
        inputs=("velocity", "position"),
        further=tuple((wave, wave) for wave in waves),
    )


def with_offset(law: FrictionLaw) -> FrictionLaw:
    """Return a law with a constant torque as its last linear parameter, named `offset`."""
    offset = PARAMETERS["offset"]
    count = len(law.linear)
    mixing = [(*row[:count], 0, *row[count:]) for row in law.mixing]
    mixing.append(tuple(int(k == count) for k in range(count + 1 + len(law.shape))))
    return replace(
        law,
        name=f"{law.name}+offset",
        linear=(*law.linear, offset),
        physical=(*law.physical, offset),
        mixing=tuple(mixing),
        columns=partial(columns.add_constant, columns=law.columns),
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
        columns=partial(columns.smooth, columns=law.columns, speed=speed),
        smoothing=speed,
        smoothness=f"Dry friction changes its sign over {speed:g} rad/s or m/s as tanh does.",
    )
