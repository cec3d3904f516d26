"""A robot and what is written of it, in text for people and as objects for programs.

Base parameters, derivation, generated code, a drafted robot file, an exported file -> blocks, dictionaries,
LaTeX, HTML.
"""

import html
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

from symid.environment import show_path
from symid.report.blocks import Block, Table, select_fields, write_html
from symid.robot import FRICTION_PARAMETERS, FRICTION_SHAPES, FrictionValues

if TYPE_CHECKING:
    from symid.codegen import GeneratedFolder, RouteCount
    from symid.dynamics import BaseParameter, BaseParameters
    from symid.identification import FileExport
    from symid.lessons import Step
    from symid.logs import Draft, LogMapDraft
    from symid.robot import Robot

_WIDTH = 100


def show_base(robot: "Robot", base: "BaseParameters") -> tuple[Block, ...]:
    """Return a headline with the counts, every parameter with its reason, and what was eliminated."""
    parameters, friction = _describe_parameters(robot, base)
    blocks: list[Block] = [_summarise_base(robot, base), *map(_show_parameter, parameters)]
    if friction:
        blocks += ["friction parameters", *map(_show_parameter, friction)]
    if base.eliminated:
        blocks += ["eliminated"]
        blocks += [f"{names}\n{_wrap_reason(reason)}" for names, reason in _gather_eliminated(base)]
    return tuple(blocks)


def tabulate_base(robot: "Robot", base: "BaseParameters") -> tuple[Block, ...]:
    """Return the same as tables, for pages wider than a terminal."""
    parameters, friction = _describe_parameters(robot, base)
    rows = [
        (entry["name"], entry["expression"], entry["form"] or entry["value"], entry["unit"], entry["reason"])
        for entry in (*parameters, *friction)
    ]
    header = ("parameter", "groups", "value", "unit", "why")
    gone = [Table(("eliminated", "why"), _gather_eliminated(base), left=(0, 1))] if base.eliminated else []
    return (_summarise_base(robot, base), Table(header, rows, left=(0, 1, 3, 4)), *gone)


def _summarise_base(robot: "Robot", base: "BaseParameters") -> str:
    from symid.dynamics import DRIVE_PARAMETERS
    from symid.notation import INERTIAL

    inertial = (*INERTIAL, *DRIVE_PARAMETERS)
    whole = base.count + sum(entry.label[1] in inertial for entry in base.eliminated)
    return f"{robot.name}: {base.count} base parameter{'s' if base.count != 1 else ''} of {whole}"


def describe_base(robot: "Robot", base: "BaseParameters") -> dict[str, object]:
    """Return the base parameters as `symid base --json` gives them."""
    from symid.dynamics import write_label

    parameters, friction = _describe_parameters(robot, base)
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


def write_base_latex(robot: "Robot", base: "BaseParameters") -> str:
    """Return every parameter with what it groups as aligned formulas."""
    from sympy import Add, Symbol, latex

    from symid.dynamics import write_label, write_name_latex

    lines = []
    for entry in (*base.parameters, *base.friction):
        letters = {label: Symbol(write_label(robot, label)) for label, _ in entry.terms}
        names = {symbol: write_name_latex(str(symbol)) for symbol in letters.values()}
        total = Add(*(factor * letters[label] for label, factor in entry.terms), evaluate=False)
        lines.append(rf"{write_name_latex(entry.name)} &= {latex(total, symbol_names=names, order='none')}")
    return "$$\\begin{aligned}" + r" \\ ".join(lines) + "\\end{aligned}$$"


def _describe_parameters(
    robot: "Robot", base: "BaseParameters"
) -> tuple[list[dict[str, object]], list[dict[str, object]]]:
    from symid.dynamics import compute_parameter_values, derive_parameter_formulas

    values = compute_parameter_values(robot, base)
    forms = derive_parameter_formulas(robot, base)
    return (
        [_describe_parameter(robot, entry, values, forms) for entry in base.parameters],
        [_describe_parameter(robot, entry, values, forms) for entry in base.friction],
    )


def _show_parameter(entry: Mapping[str, object]) -> str:
    """Return a parameter in two lines: what it groups, and why."""
    parts = [str(entry["name"])]
    if entry["expression"] != entry["name"]:
        parts.append(str(entry["expression"]))
    if entry["form"] is not None:
        parts.append(str(entry["form"]))
    if entry["value"] is not None:
        parts.append(f"{entry['value']:.6g}")
    return f"{' = '.join(parts)}  [{entry['unit']}]\n{_wrap_reason(str(entry['reason']))}"


def _gather_eliminated(base: "BaseParameters") -> list[tuple[str, str]]:
    """Return the eliminated parameters with their reasons, those with one reason together, in their order."""
    names: dict[str, list[str]] = {}
    for entry in base.eliminated:
        names.setdefault(entry.reason, []).append(entry.name)
    return [(", ".join(group), reason) for reason, group in names.items()]


def _wrap_reason(text: str) -> str:
    return textwrap.fill(text, width=_WIDTH, initial_indent="    ", subsequent_indent="    ")


def _describe_parameter(
    robot: "Robot", entry: "BaseParameter", values: Mapping[str, float], forms: Mapping[str, object]
) -> dict[str, object]:
    from symid.dynamics import get_label_unit, get_owner

    return {
        "name": entry.name,
        "expression": entry.expression,
        "reason": entry.reason,
        "unit": get_label_unit(robot, entry.label),
        "joint": get_owner(robot, entry.label),
        "value": values.get(entry.name),
        "form": str(forms[entry.name]).replace("**", "^") if entry.name in forms else None,
    }


_INTRO = (
    "Operations of generated functions: products with squares and divisions, sums, sines and cosines.\n"
    "Of the routes that give a function the one with the fewest is written; 'most' has the worst one's "
    "products and sums."
)


def describe_derivation(
    robot: str, steps: Sequence["Step"], counts: Sequence["RouteCount"]
) -> dict[str, object]:
    """Return a derivation as `symid derive --json` gives it, with the operations of every route."""
    return {
        "robot": robot,
        "steps": [asdict(step) for step in steps],
        "operations": [
            {**select_fields(entry, "function route chosen"), **asdict(entry.operations)} for entry in counts
        ],
    }


def show_derivation(
    steps: Sequence["Step"], counts: Sequence["RouteCount"], *, latex: bool = False
) -> tuple[Block, ...]:
    """Return the steps as paragraphs, formulas in text or LaTeX, and the table of operations."""
    paragraphs = (_show_step(number, step, latex=latex) for number, step in enumerate(steps, start=1))
    return (*paragraphs, _show_counts(counts))


def write_derivation_latex(steps: Sequence["Step"]) -> str:
    """Return titles and formulas as aligned equations."""
    lines = []
    for number, step in enumerate(steps, start=1):
        lines.append(rf"&\textbf{{{number}. {step.title}}}")
        lines += [rf"{entry.left_latex} &= {entry.latex}" for entry in step.formulas]
    return "$$\\begin{aligned}" + " \\\\ ".join(lines) + "\\end{aligned}$$"


def write_derivation_html(steps: Sequence["Step"], counts: Sequence["RouteCount"]) -> str:
    """Return the derivation for a notebook, which sets the formulas."""
    parts = []
    for number, step in enumerate(steps, start=1):
        parts.append(f"<h4>{number}. {html.escape(step.title)}</h4><p>{html.escape(step.sentence)}</p>")
        formulas = (rf"$\displaystyle {entry.left_latex} = {entry.latex}$" for entry in step.formulas)
        parts += [f"<p>{html.escape(formula)}</p>" for formula in formulas]
        if step.check:
            parts.append(f"<p>Checked: {html.escape(step.check)}</p>")
    return "".join((*parts, write_html((_show_counts(counts),))))


def _show_step(number: int, step: "Step", *, latex: bool) -> str:
    lines = [f"{number}. {step.title}", "", f"   {step.sentence}"]
    for entry in step.formulas:
        left, right = (entry.left_latex, entry.latex) if latex else (entry.left, entry.text)
        lines.append(f"     {left} = {right}")
    if step.check:
        lines += ["", f"   Checked: {step.check}"]
    return "\n".join(lines)


def _show_counts(counts: Sequence["RouteCount"]) -> Table:
    """Return the operations of the chosen routes as a table, the worst of the others beside them."""
    rows = []
    for entry in counts:
        if entry.chosen:
            all_routes = [other.operations for other in counts if other.function == entry.function]
            most = max(other.mul + other.add for other in all_routes)
            own = entry.operations
            rows.append((entry.function, own.mul, own.add, own.trig, most, entry.route))
    return Table(("function", "mul", "add", "trig", "most", "route"), rows, (0, 5), _INTRO)


_COUNTS = ("mul", "add", "trig")
_SIZES = ("code", "stack")


def summarise_code(made: "GeneratedFolder") -> str:
    """Return the folder, what was done, and how its self-test went."""
    state = "nothing has changed" if made.unchanged else f"{len(made.files)} files"
    head = f"{made.folder}: {state}, self-test {made.record.selftest}"
    if made.record.runner:
        head += f" with {made.record.runner} {made.record.flags}".rstrip()
    return head


def show_code(made: "GeneratedFolder") -> tuple[Block, ...]:
    """Return a headline, and the operations and sizes of every function."""
    sizes = {name: asdict(size) for name, size in made.record.sizes.items()}
    header = ("function", *_COUNTS, *(_SIZES if sizes else ()))
    rows = [
        (
            name,
            *(counts[key] for key in _COUNTS),
            *(sizes[name][key] for key in _SIZES if name in sizes),
        )
        for name, counts in made.operations.items()
    ]
    units = ("code and stack in bytes; batches in manifest.json",) if sizes else ()
    return (summarise_code(made), Table(header, rows), *units)


def describe_code(robot: str, made: "GeneratedFolder") -> dict[str, object]:
    """Return what was written as `symid generate --json` gives it."""
    record = made.record
    return {
        "robot": robot,
        "target": made.manifest["target"],
        "folder": str(made.folder),
        "files": [str(path) for path in made.files],
        "operations": made.operations,
        "selftest": record.selftest,
        "runner": record.runner,
        "flags": record.flags,
        "sizes": {name: asdict(size) for name, size in record.sizes.items()},
        "unchanged": made.unchanged,
    }


def summarise_draft(robot: "Robot") -> str:
    """Return name and number of joints."""
    plural = "s" if len(robot.joints) != 1 else ""
    return f"{robot.name}, {len(robot.joints)} joint{plural}"


def show_draft(draft: "Draft") -> tuple[Block, ...]:
    """Return the robot, and the columns and units of its log."""
    log = () if draft.log is None else (_show_log(draft.log),)
    return (summarise_draft(draft.robot), *log)


def _show_log(part: "LogMapDraft") -> Table:
    preset = "" if part.found.log.preset is None else f" (columns of {part.found.log.preset})"
    units = _list_units(part)
    rows = [(name, ", ".join(entry.columns), units[name]) for name, entry in part.found.read.items()]
    header = ("quantity", "columns", "unit")
    return Table(header, rows, left=(0, 1, 2), title=f"log: {part.file}{preset}")


def _list_units(part: "LogMapDraft") -> dict[str, str]:
    return {name: ", ".join(part.found.units[name]) for name in part.found.read}


def describe_draft(draft: "Draft") -> dict[str, object]:
    """Return robot, joints and log as `symid new --json` gives them."""
    joints = [{"name": joint.name, "kind": joint.kind.value} for joint in draft.robot.joints]
    log = {} if draft.log is None else {"log": _describe_log(draft.log)}
    return {"robot": draft.robot.name, "joints": joints, **log, "notices": len(draft.notices)}


def _describe_log(part: "LogMapDraft") -> dict[str, object]:
    return {
        "file": part.file,
        "preset": part.found.log.preset,
        "columns": {name: list(entry.columns) for name, entry in part.found.read.items()},
        "units": _list_units(part),
        "unused": list(part.found.unused),
        "standstill": part.robot.processing.standstill,
        "dropped": part.robot.processing.drop_first,
    }


def show_export(found: "FileExport") -> tuple[Block, ...]:
    """Return what was written and where, and how bodies were found or which laws joints have."""
    lines = [f"{found.format}: {show_path(found.file)}"]
    if found.standard is not None:
        lines.append(found.standard.outcome.value)
    if found.friction is not None:
        laws = found.friction.laws
        lines += [
            f"{joint}: {laws[joint]} as {entry.kind.value}" for joint, entry in found.friction.values.items()
        ]
    return ("\n".join(lines),)


def describe_export(found: "FileExport") -> dict[str, object]:
    """Return the export as `symid export --json` gives it."""
    if found.friction is not None:
        return {
            "file": str(found.file),
            "robot": found.robot.name,
            "written": {
                joint: {"law": found.friction.laws[joint], **_describe_values(values)}
                for joint, values in found.friction.values.items()
            },
            "kept": dict(found.friction.kept),
        }
    result = {
        "file": str(found.file),
        "format": found.format,
        "robot": found.robot.name,
        "elastic": any(found.robot.elastic),
        "outcome": found.outcome,
    }
    if found.standard is not None:
        result["largest_change"] = max(map(abs, found.standard.residual.tolist()), default=0.0)
        result["blamed"] = found.standard.blamed
        result["not_identified"] = found.missing
    return {**result, "left_out": found.left_out}


def _describe_values(values: FrictionValues) -> dict[str, object]:
    names = FRICTION_PARAMETERS[values.kind]
    shapes = [key.name for key in FRICTION_SHAPES.get(values.kind, ())]
    return {
        "model": values.kind.value,
        "values": dict(zip(names, values.values or (), strict=True)),
        "shape": dict(zip(shapes, values.shape, strict=True)),
        "smoothing": values.smoothing,
    }
