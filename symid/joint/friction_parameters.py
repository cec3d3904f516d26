"""The parameters of friction laws: name, LaTeX, units, meaning, physical bounds.

Output: `PARAMETERS` by name, waves of any order. Linear parameters begin with a capital F, the same as papers
print them with a small f; where both are one number, their bounds agree.

Supported: all laws of `symid.joint.friction_laws`.
"""

from symid.joint.friction_law import LawParameter

__all__ = ["PARAMETERS", "build_power", "build_waves"]

_UNITS = {
    "level": ("N m", "N"),
    "viscous": ("N m s/rad", "N s/m"),
    "speed": ("rad/s", "m/s"),
    "slope": ("s/rad", "s/m"),
    "number": ("1", "1"),
}
_INFINITY = float("inf")


def _build(  # noqa: PLR0917 - one row of a table
    name: str,
    latex: str,
    kind: str,
    meaning: str,
    lower: float = 0.0,
    upper: float = _INFINITY,
    start: float | None = None,
    allowed: bool = True,  # noqa: FBT001, FBT002 - one column of a table
) -> LawParameter:
    unit, unit_prismatic = _UNITS[kind]
    return LawParameter(
        name=name,
        latex=latex,
        unit=unit,
        unit_prismatic=unit_prismatic,
        meaning=meaning,
        lower=lower,
        upper=upper,
        start=start,
        lower_is_allowed=allowed,
    )


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

_LINEAR_NAMES = {"V": "v", "C": "c", "Vp": "vp", "Cp": "cp", "Vn": "vn", "Cn": "cn", "P": "p", "D": "d"}
_LINEAR_NAMES |= {"L": "l", "M": "m"}

PARAMETERS: dict[str, LawParameter] = {
    parameter.name: parameter
    for parameter in (
        *(_build(f"f{end}", f"f_{tex}", kind, text, low) for end, tex, kind, text, low in _TWINS),
        *(
            _build(f"F{_LINEAR_NAMES[end]}", f"F_{tex}", kind, text, low)
            for end, tex, kind, text, low in _TWINS
        ),
        _build("fS", "f_S", "level", "static friction, at the start of motion"),
        _build("Fs", "F_s", "level", "static friction beyond Coulomb friction", -_INFINITY),
        _build("fE", "f_E", "level", "static friction beyond Coulomb friction", -_INFINITY),
        _build("fSp", "f_S^+", "level", "static friction, positive velocity"),
        _build("fSn", "f_S^-", "level", "static friction, negative velocity"),
        _build("Fsp", "F_s^+", "level", "static beyond Coulomb friction, positive velocity", -_INFINITY),
        _build("Fsn", "F_s^-", "level", "static beyond Coulomb friction, negative velocity", -_INFINITY),
        _build("fLS", "f_{LS}", "number", "static friction per torque of the load"),
        _build(
            "Fls", "F_{ls}", "number", "static beyond Coulomb friction per torque of the load", -_INFINITY
        ),
        _build("offset", r"\tau_0", "level", "constant torque: drive offset, asymmetry", -_INFINITY),
        _build("vs", "v_s", "speed", "Stribeck velocity", start=0.05, allowed=False),
        _build("gamma", r"\gamma", "number", "Stribeck exponent", 0.5, 4.0, 2.0),
        _build("dq0", r"\dot q_0", "speed", "edge of the zone around standstill", start=0.01, allowed=False),
        _build("dqs", r"\dot q_0", "speed", "velocity at which friction changes its sign", start=0.0),
        _build("delta", r"\delta", "number", "exponent of viscous friction", 0.05, 3.0, 0.7),
        _build("g2", r"\gamma_2", "slope", "slope of the rise at standstill", start=100.0, allowed=False),
        _build("g3", r"\gamma_3", "slope", "slope of the fall after it", start=10.0, allowed=False),
        _build("g5", r"\gamma_5", "slope", "slope of Coulomb friction", start=100.0, allowed=False),
    )
}


def build_power(order: int) -> tuple[LawParameter, LawParameter]:
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


def build_waves(order: int) -> tuple[LawParameter, LawParameter]:
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
