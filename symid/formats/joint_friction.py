"""Friction of a joint or coupling: the `friction` table of a robot file.

Input: the table around it. Output: `FrictionValues`.

Supported: the models of `FrictionKind`; all values of a model, or none where they are unknown; a speed over
which dry friction changes its sign.
"""

from symid.formats.section import POSITIVE, Section, read_choice, read_number, read_table
from symid.robot.description import FrictionKind, FrictionValues

__all__ = ["FRICTION_PARAMETERS", "find_friction_unit", "read_friction"]

FRICTION_PARAMETERS: dict[FrictionKind, tuple[str, ...]] = {
    FrictionKind.NONE: (),
    FrictionKind.VISCOUS_COULOMB: ("Fv", "Fc"),
    FrictionKind.VISCOUS_COULOMB_OFFSET: ("Fv", "Fc", "offset"),
    FrictionKind.ASYMMETRIC: ("Fvp", "Fcp", "Fvn", "Fcn"),
}
"""The parameters of each friction model, in the order of its values."""


def read_friction(section: Section, *, prismatic: bool) -> FrictionValues:
    """Return the friction of a joint's or coupling's table; none where it states none."""
    names = sorted({name for group in FRICTION_PARAMETERS.values() for name in group})
    table = read_table(section, "friction", ("model", *names, "smoothing"))
    if table is None:
        return FrictionValues()
    if "model" not in table.values:
        table.refuse_key("robot.missing-key", "model", 'missing; write model = "viscous_coulomb"')
    model = read_choice(table, "model", [kind.value for kind in FrictionKind])
    smoothing = read_number(table, "smoothing", "m/s" if prismatic else "rad/s", POSITIVE)
    if model is None:
        for name in names:
            read_number(table, name, find_friction_unit(name, prismatic=prismatic))
        return FrictionValues()
    kind = FrictionKind(model)
    if kind is FrictionKind.NONE and "smoothing" in table.values:
        text = 'has nothing to smooth: the model "none" has no dry friction; leave it out'
        table.refuse_key("robot.friction-values", "smoothing", text)
    _check_names(table, kind, names)
    wanted = FRICTION_PARAMETERS[kind]
    given = [read_number(table, name, find_friction_unit(name, prismatic=prismatic)) for name in wanted]
    for name, value in zip(wanted, given, strict=True):
        if name != "offset" and value is not None and value < 0:
            text = f"{value} drives the joint instead of braking it; friction coefficients are positive"
            table.warn("robot.negative-friction", name, text)
    values = tuple(float(value) for value in given if value is not None)
    return FrictionValues(
        kind=kind,
        values=values if values and len(values) == len(wanted) else None,
        smoothing=float(smoothing or 0),
    )


def _check_names(table: Section, kind: FrictionKind, names: list[str]) -> None:
    wanted = FRICTION_PARAMETERS[kind]
    for name in names:
        if name in table.values and name not in wanted:
            allowed = f"its values are {', '.join(wanted)}" if wanted else "it has no values"
            text = f'not a value of the model "{kind.value}"; {allowed}'
            table.refuse_key("robot.friction-values", name, text)
    missing = [name for name in wanted if name not in table.values]
    if missing and len(missing) < len(wanted):
        text = (
            f"without {', '.join(missing)}; give all of {', '.join(wanted)}, or none where they are unknown"
        )
        table.refuse_key("robot.friction-values", next(name for name in wanted if name in table.values), text)


def find_friction_unit(name: str, *, prismatic: bool) -> str:
    """Return the unit of a friction parameter as robot files write it."""
    if name.startswith("Fv"):
        return "N*s/m" if prismatic else "N*m*s/rad"
    return "N" if prismatic else "N*m"
