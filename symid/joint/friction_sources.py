"""What is to be said about friction laws: formula, source, smoothness, passivity.

Output: `LawTexts` of each law.

Supported: the laws of `symid.joint.friction_laws`; the LaTeX comes from their columns (`friction_text`).
"""

from dataclasses import dataclass

__all__ = [
    "ASYMMETRIC",
    "COULOMB",
    "COULOMB_VISCOUS",
    "LORENTZIAN",
    "MAKKAR",
    "POWER_LAW",
    "LawTexts",
    "describe_asymmetric_stribeck",
    "describe_improved",
    "describe_load_dependent",
    "describe_polynomial",
    "describe_position_dependent",
    "describe_stribeck",
]

_JUMP = "Jumps at zero velocity (sign), smooth elsewhere and in all parameters."
_NOT_NEGATIVE = "Never pushes where no coefficient is negative."
_GAUSSIAN = "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083-1138"
_ZHANG = "after Zhang, Hu, Zou, J. Zhejiang Univ. (Eng. Sci.) 55 (2021) 801-809, whose formula is not known"


@dataclass(frozen=True, slots=True, kw_only=True)
class LawTexts:
    """Formula in ASCII and three sentences."""

    formula: str
    source: str
    smoothness: str = _JUMP
    passivity: str = _NOT_NEGATIVE


COULOMB = LawTexts(formula="fC sign(dq)", source="Coulomb (1785)")
COULOMB_VISCOUS = LawTexts(formula="fC sign(dq) + fV dq", source="Coulomb (1785), Reynolds (1886)")
ASYMMETRIC = LawTexts(
    formula="fCp + fVp dq for dq > 0, -fCn + fVn dq for dq < 0",
    source="Janot, Gautier, Brunot, data set and reference models of EMPS (2019)",
)
LORENTZIAN = LawTexts(
    formula="[fC + (fS - fC) / (1 + (dq / vs)^2)] sign(dq) + fV dq",
    source="Hess, Soom, Journal of Tribology 112 (1990) 147-152",
)
POWER_LAW = LawTexts(
    formula="fC sign(dq) + fD |dq|^delta sign(dq)",
    source="a power of the velocity, as in Wolf, Iskandar, ICRA 2018",
    smoothness="Jumps at zero velocity, where for delta < 1 its slope grows without bound; smooth elsewhere.",
)
MAKKAR = LawTexts(
    formula="fM [tanh(g2 dq) - tanh(g3 dq)] + fC tanh(g5 dq) + fV dq",
    source="Makkar, Dixon, Sawyer, Hu, AIM 2005, 600-605",
    smoothness="Smooth in the velocity and in all parameters.",
    passivity="Never pushes where no coefficient is negative and g2 >= g3.",
)


def _write_power(base: str, exponent: float | None) -> str:
    """Return a power, of gamma for None, without an exponent of one."""
    if exponent == 1.0:
        return base
    return f"{base}^{'gamma' if exponent is None else f'{exponent:g}'}"


def _write_fall(exponent: float | None) -> str:
    return f"exp(-{_write_power('|dq / vs|', exponent)})"


def _write_further(orders: tuple[int, ...]) -> str:
    return "".join(f" + fV{order} {_write_power('|dq|', order - 1)} dq" for order in orders)


def _find_stribeck_source(exponent: float | None) -> str:
    if exponent == 1.0:
        return "Tustin, Journal of the IEE 94 (1947) 143-151"
    if exponent == 2.0:
        return _GAUSSIAN
    return "Bo, Pavelescu, Wear 82 (1982) 277-289"


def describe_stribeck(exponent: float | None, orders: tuple[int, ...]) -> LawTexts:
    """Return the texts of Stribeck's curve."""
    return LawTexts(
        formula=f"[fC + (fS - fC) {_write_fall(exponent)}] sign(dq) + fV dq{_write_further(orders)}",
        source=_find_stribeck_source(exponent),
    )


def describe_polynomial(orders: tuple[int, ...]) -> LawTexts:
    """Return the texts of polynomial viscous friction."""
    return LawTexts(
        formula=f"fC sign(dq) + fV dq{_write_further(orders)}",
        source="a polynomial of the velocity, as in Simoni, Beschi, Visioli, Legnani, Robotica 35 (2017)",
    )


def describe_improved(reading: str, exponent: float | None) -> LawTexts:
    """Return the texts of a reading of the improved law."""
    curve = f"g(v) = fC + (fS - fC) exp(-{_write_power('(|v| / vs)', exponent)}) + fV |v|"
    formulas = {
        "H1": "fP + g(dq) sign(dq) for |dq| >= dq0, fP + g(dq0) dq / dq0 within",
        "H2": "g(dq) sign(dq) for |dq| >= dq0, straight lines from fP at rest to +-g(dq0) within",
        "H3": "fP + g(dq) sign(dq)",
        "H4": "fP + g(dq - dq0) sign(dq - dq0)",
    }
    zone = "Continuous in the velocity, with knees at +-dq0; smooth in vs, gamma, piecewise in dq0."
    smoothness = {
        "H1": zone,
        "H2": zone,
        "H3": _JUMP,
        "H4": "Jumps at dq0, in the velocity and in dq0; smooth elsewhere.",
    }
    passivity = {
        "H1": "Pushes near standstill unless fP is zero.",
        "H2": "Pushes near standstill unless fP is zero.",
        "H3": "Pushes in one direction where |fP| is more than the friction.",
        "H4": "Pushes between standstill and dq0.",
    }
    return LawTexts(
        formula=f"{formulas[reading]}; {curve}",
        source=f"reading {reading}, {_ZHANG}",
        smoothness=smoothness[reading],
        passivity=passivity[reading],
    )


def describe_asymmetric_stribeck(exponent: float | None, bumps: int) -> LawTexts:
    """Return the texts of Stribeck friction by direction."""
    fall = _write_fall(exponent)
    parts = ("fE", "fE") if bumps == 1 else ("(fSp - fCp)", "(fSn - fCn)")
    return LawTexts(
        formula=f"fCp + {parts[0]} {fall} + fVp dq for dq > 0, -fCn - {parts[1]} {fall} + fVn dq for dq < 0",
        source=_find_stribeck_source(exponent) + "; by direction as EMPS",
    )


def describe_load_dependent(exponent: float | None, *, falls: bool) -> LawTexts:
    """Return the texts of friction that grows with the load."""
    if not falls:
        return LawTexts(
            formula="(fC + fL |load|) sign(dq) + fV dq",
            source="Bittencourt, Gunnarsson, J. Dyn. Sys. Meas. Control 134 (2012) 051013",
        )
    fall = _write_fall(exponent)
    return LawTexts(
        formula=f"[fC + fL |load| + (fS - fC + (fLS - fL) |load|) {fall}] sign(dq) + fV dq",
        source="Bittencourt, Gunnarsson, J. Dyn. Sys. Meas. Control 134 (2012) 051013, without temperature",
    )


def describe_position_dependent(*, dry: bool) -> LawTexts:
    """Return the texts of friction with waves of the motor's angle."""
    waves = "sum_k [Ak cos(k theta) + Bk sin(k theta)]"
    if dry:
        return LawTexts(
            formula=f"[fC + {waves}] sign(dq) + fV dq, theta: angle of the motor",
            source="Fourier series of the motor's angle",
            passivity="Never pushes where fC is at least the sum of all |Ak|, |Bk|, and fV is not negative.",
        )
    return LawTexts(
        formula=f"fC sign(dq) + fV dq + {waves}, theta: angle of the motor",
        source="Fourier series of the motor's angle",
        passivity="The waves push and brake in turn, and do no work over a turn; the rest never pushes.",
    )
