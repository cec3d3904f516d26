"""The base parameters of a robot, in paragraphs for people and as an object for programs.

Input: `BaseParameters` and their robot. Output: blocks, dictionaries, LaTeX.
"""

import textwrap
from collections.abc import Mapping
from typing import TYPE_CHECKING

from symid.report.blocks import Block, format_table

if TYPE_CHECKING:  # these load SymPy
    from symid.parameters.base import BaseParameter, BaseParameters
    from symid.robot.description import Robot

__all__ = ["describe_base", "show_base", "tabulate_base", "write_latex"]

_WIDTH = 100


def show_base(robot: "Robot", base: "BaseParameters") -> tuple[Block, ...]:
    """Return a headline with the counts, every parameter with its reason, and what was eliminated."""
    parameters, friction = _describe_all(robot, base)
    blocks: list[Block] = [_summarise(robot, base), *map(_show, parameters)]
    if friction:
        blocks += ["friction parameters", *map(_show, friction)]
    if base.eliminated:
        blocks += ["eliminated"]
        blocks += [f"{names}\n{_wrap(reason)}" for names, reason in _gather(base)]
    return tuple(blocks)


def tabulate_base(robot: "Robot", base: "BaseParameters") -> tuple[Block, ...]:
    """Return the same as tables, for pages wider than a terminal."""
    parameters, friction = _describe_all(robot, base)
    rows = [
        (entry["name"], entry["expression"], entry["form"] or entry["value"], entry["unit"], entry["reason"])
        for entry in (*parameters, *friction)
    ]
    header = ("parameter", "groups", "value", "unit", "why")
    gone = [format_table(("eliminated", "why"), _gather(base), left=(0, 1))] if base.eliminated else []
    return (_summarise(robot, base), format_table(header, rows, left=(0, 1, 3, 4)), *gone)


def _summarise(robot: "Robot", base: "BaseParameters") -> str:
    from symid.dynamics.drives import DRIVE
    from symid.notation import INERTIAL

    inertial = (*INERTIAL, *DRIVE)
    whole = base.count + sum(entry.label[1] in inertial for entry in base.eliminated)
    return f"{robot.name}: {base.count} base parameter{'s' if base.count != 1 else ''} of {whole}"


def describe_base(robot: "Robot", base: "BaseParameters") -> dict[str, object]:
    """Return the base parameters as `symid base --json` gives them."""
    from symid.dynamics.labels import write_label

    parameters, friction = _describe_all(robot, base)
    return {
        "robot": robot.name,
        "count": base.count,
        "parameters": parameters,
        "friction": friction,
        "eliminated": [{"name": entry.name, "reason": entry.reason} for entry in base.eliminated],
        # Changes of the parameters that nothing shows, exact coefficients as text.
        "null_space": [
            {write_label(robot, label): str(coefficient) for label, coefficient in change}
            for change in base.null_space
        ],
    }


def write_latex(robot: "Robot", base: "BaseParameters") -> str:
    """Return every parameter with what it groups as aligned formulas."""
    from sympy import Add, Symbol, latex

    from symid.algebra.display import write_left
    from symid.dynamics.labels import write_label

    lines = []
    for entry in (*base.parameters, *base.friction):
        letters = {label: Symbol(write_label(robot, label)) for label, _ in entry.terms}
        names = {symbol: write_left(str(symbol)) for symbol in letters.values()}
        total = Add(*(factor * letters[label] for label, factor in entry.terms), evaluate=False)
        lines.append(rf"{write_left(entry.name)} &= {latex(total, symbol_names=names, order='none')}")
    return "$$\\begin{aligned}" + r" \\ ".join(lines) + "\\end{aligned}$$"


def _describe_all(
    robot: "Robot", base: "BaseParameters"
) -> tuple[list[dict[str, object]], list[dict[str, object]]]:
    from symid.parameters.values import find_parameter_forms, find_parameter_values

    values = find_parameter_values(robot, base)
    forms = find_parameter_forms(robot, base)
    return (
        [_describe(robot, entry, values, forms) for entry in base.parameters],
        [_describe(robot, entry, values, forms) for entry in base.friction],
    )


def _show(entry: Mapping[str, object]) -> str:
    """Return a parameter in two lines: what it groups, and why."""
    parts = [str(entry["name"])]
    if entry["expression"] != entry["name"]:
        parts.append(str(entry["expression"]))
    if entry["form"] is not None:
        parts.append(str(entry["form"]))
    if entry["value"] is not None:
        parts.append(f"{entry['value']:.6g}")
    return f"{' = '.join(parts)}  [{entry['unit']}]\n{_wrap(str(entry['reason']))}"


def _gather(base: "BaseParameters") -> list[tuple[str, str]]:
    """Return the eliminated parameters with their reasons, those with one reason together, in their order."""
    names: dict[str, list[str]] = {}
    for entry in base.eliminated:
        names.setdefault(entry.reason, []).append(entry.name)
    return [(", ".join(group), reason) for reason, group in names.items()]


def _wrap(text: str) -> str:
    return textwrap.fill(text, width=_WIDTH, initial_indent="    ", subsequent_indent="    ")


def _describe(
    robot: "Robot", entry: "BaseParameter", values: Mapping[str, float], forms: Mapping[str, object]
) -> dict[str, object]:
    from symid.dynamics.labels import find_label_unit, find_owner

    return {
        "name": entry.name,
        "expression": entry.expression,
        "reason": entry.reason,
        "unit": find_label_unit(robot, entry.label),
        "joint": find_owner(robot, entry.label),
        "value": values.get(entry.name),
        "form": str(forms[entry.name]).replace("**", "^") if entry.name in forms else None,
    }
