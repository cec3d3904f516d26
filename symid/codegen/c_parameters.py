"""The parameters of the example programs: tables, where each vector begins, how a file of values is read.

Input: `Material`, the vectors that the example's functions may take. Output: lines of C.

Supported: vectors that functions take as arguments; vectors that are baked into the functions are left out.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from symid.codegen.c_tables import write_lines
from symid.codegen.describe import Material
from symid.codegen.functions import ModelCard, ParameterCard
from symid.codegen.templates import write_template

__all__ = ["ExampleParameters", "ParametersContext", "build_example_parameters", "list_arguments"]

_TITLES = {"rotor": "IA"}


@dataclass(frozen=True, slots=True, kw_only=True)
class ParametersContext:
    """parameters.c.jinja."""

    real: str
    scan: str
    names: str
    value_lines: tuple[str, ...]
    pointer_lines: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ExampleParameters:
    """Lines of an example program, and what `main` takes."""

    usage_lines: tuple[str, ...]
    lines: tuple[str, ...]
    reading_lines: tuple[str, ...]
    arguments: str


def list_arguments(card: ModelCard) -> frozenset[str]:
    """Return the names of all inputs of all functions."""
    return frozenset(port.name for spec in card.functions for port in spec.inputs)


def _write_usage(names: str, *, known: bool) -> tuple[str, ...]:
    values = "the robot file's values are used" if known else "there are none: the robot file lacks values"
    return (
        f"Usage: control_loop [FILE]    FILE holds {names}, as numbers between blanks: identified values,",
        f"for example. Without it {values}.",
    )


def build_example_parameters(
    material: Material, vectors: Mapping[str, Sequence[ParameterCard]]
) -> ExampleParameters:
    """Return the lines for vectors by the names that they have in the program, in the order of a file."""
    real = material.options.precision
    if not vectors:
        text = "Usage: control_loop    All parameters are part of the functions."
        return ExampleParameters(usage_lines=(text,), lines=(), reading_lines=(), arguments="void")
    values = [entry.value for entries in vectors.values() for entry in entries]
    known = all(value is not None for value in values)
    names = ", then ".join(_TITLES.get(name, name) for name in vectors)
    pointers, start = [], 0
    for name, entries in vectors.items():
        pointers.append(f"static const {real} *const {name} = parameters + {start};")
        start += len(entries)
    context = ParametersContext(
        real=real,
        scan="%f" if real == "float" else "%lf",
        names=names,
        value_lines=write_lines([value or 0.0 for value in values] if known else [0.0], real),
        pointer_lines=tuple(pointers),
    )
    defines = (f"#define PARAMETERS {max(len(values), 1)}", f"#define KNOWN {int(known)}", "")
    text = write_template("c/parameters.c.jinja", context).rstrip("\n")
    return ExampleParameters(
        usage_lines=_write_usage(names, known=known),
        lines=(*defines, *text.split("\n"), ""),
        reading_lines=(
            "if (count > 1 ? !read_parameters(arguments[1]) : !KNOWN) {",
            f'    fprintf(stderr, "usage: control_loop FILE    FILE: %d numbers, {names}\\n", PARAMETERS);',
            "    return 2;",
            "}",
        ),
        arguments="int count, char **arguments",
    )
