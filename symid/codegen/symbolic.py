"""The catalogue as exact SymPy expressions: numbers as in the robot file, roots and lengths as symbols.

Robot -> BaseParameters -> routes over exact numbers -> the program that is shortest written out -> SymPy.

Supported: every function of the catalogue; symbolic lengths, with a value or without.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import sympy
from sympy import Expr, ImmutableDenseMatrix, Rational, Symbol

from symid.codegen import functions
from symid.codegen.equation_routes import build_workspace
from symid.codegen.expressions import ExactProgram, count_expanded_operations, share_values, write_values
from symid.codegen.routes import list_routes
from symid.dynamics import (
    BaseParameters,
    build_standard_parameters,
    derive_base_parameters,
    list_symbols,
    write_name_latex,
)
from symid.errors import Notice, UsageError
from symid.notation import SYMBOLS
from symid.robot import Robot

SymbolicOutput: TypeAlias = Expr | ImmutableDenseMatrix | tuple[ImmutableDenseMatrix, ...]
"""An output: a scalar, a column or matrix, or one matrix a link."""

_LONGEST_PRINT = 20_000
_LATEX = {symbol.name: symbol.latex for symbol in SYMBOLS}
_LATEX |= {"dddq": r"\dddot q", "ddddq": r"\ddddot q", "dqr": r"\dot q_r", "ddqr": r"\ddot q_r"}
_OUTPUT_LATEX = {
    "Yr": "Y_r",
    "YL": "Y_L",
    "Yf": "Y_f",
    "hT": "h_T",
    "hV": "h_V",
    "tau_f": r"\tau_f",
    "P_next": "P^+",
    "Q_next": "Q^+",
    "dtau_dq": r"\frac{\partial \tau}{\partial q}",
    "dtau_ddq": r"\frac{\partial \tau}{\partial \dot q}",
    "dtau_dddq": r"\frac{\partial \tau}{\partial \ddot q}",
    "d2tau_dq2": r"\frac{\partial^2 \tau}{\partial q^2}",
    "d2tau_dq_ddq": r"\frac{\partial^2 \tau}{\partial q \partial \dot q}",
    "d2tau_ddq2": r"\frac{\partial^2 \tau}{\partial \dot q^2}",
    "dM_dq": r"\frac{\partial M}{\partial q}",
    "dddq_dq": r"\frac{\partial \ddot q}{\partial q}",
    "dddq_ddq": r"\frac{\partial \ddot q}{\partial \dot q}",
    "dddq_dtau": r"\frac{\partial \ddot q}{\partial \tau}",
}
_INDEXED = re.compile(r"^(?P<letter>[^_^]+)(_\{?(?P<below>[^{}^]+)\}?)?(?P<above>\^.+)?$")
_NUMBERED = re.compile(r"^(?P<letter>[A-Za-z_]+?)(?P<place>c|\d*)_?(?P<number>\d+)$")


@dataclass(frozen=True, slots=True, kw_only=True)
class SymbolicFunction:
    """A function of the catalogue in exact symbols.

    Short polynomials are collected by parameters, then by sines and cosines. Longer expressions are nested,
    as the recursion makes them: nothing is expanded or simplified.

    Attributes:
        name: in the catalogue. meaning: in words.
        inputs: per input a column of symbols, in the order of the catalogue.
        outputs: per output a scalar, a column or matrix, or for shape (links, 3, 3) a matrix a link.
        units: of inputs and outputs, for revolute joints.
        lengths: the symbolic lengths in the expressions and their values in m, None for no value.
        operations: sums, products and functions when every output is written out.
        route: how the expressions were derived.
        names: the LaTeX of the symbols. source: the program behind the expressions.
    """

    name: str
    meaning: str
    inputs: Mapping[str, ImmutableDenseMatrix]
    outputs: Mapping[str, SymbolicOutput]
    units: Mapping[str, str]
    lengths: Mapping[Symbol, Rational | None]
    operations: int
    route: str
    names: Mapping[Symbol, str]
    source: ExactProgram

    @property
    def expr(self) -> SymbolicOutput:
        """Return the output of a function that has one alone; a UsageError where there are several."""
        if len(self.outputs) > 1:
            text = f"function '{self.name}' has the outputs {', '.join(self.outputs)}; take one by its name"
            raise UsageError(Notice(code="usage.several-outputs", text=text))
        return next(iter(self.outputs.values()))

    def __getitem__(self, name: str) -> SymbolicOutput:
        """Return the output called `name`."""
        return self.outputs[name]

    def __repr__(self) -> str:
        """Return the call in one line, as mass_matrix(q, beta) -> M."""
        return f"{self.name}({', '.join(self.inputs)}) -> {', '.join(self.outputs)}"

    def share(self) -> tuple[tuple[tuple[Symbol, Expr], ...], Mapping[str, SymbolicOutput]]:
        """Return the outputs with a symbol for every value that is used more than once.

        The definitions come first, each before it is used: the form of `sympy.cse`, with about as many
        operations as generated code has.
        """
        steps, values = share_values(self.source)
        return steps, _shape_outputs(self.source.program.spec, values)

    def lambdify(self, modules: str = "numpy") -> Callable[..., Any]:
        """Return a Python function of one array an input that returns the list of outputs.

        Like `sympy.lambdify` with `cse`, but faster: the shared values are those of `share`.

        Args:
            modules: as in `sympy.lambdify`: "numpy", "math", "mpmath", "jax".
        """
        steps, outputs = self.share()
        arguments = (*self.inputs.values(), *([tuple(self.lengths)] if self.lengths else ()))
        reduced = list(outputs.values())

        def share(_expressions: object, **_options: object) -> tuple[object, object]:
            return steps, reduced

        function: Callable[..., Any] = sympy.lambdify(arguments, reduced, modules=modules, cse=share)
        return function

    def latex(self) -> str:
        """Return one equation a line, output = expression, with the letters of `symid.notation`.

        Raises:
            UsageError: the expressions have more than 20 000 operations.
        """
        if self.operations > _LONGEST_PRINT:
            text = f"function '{self.name}' has {self.operations} operations when written out, more than "
            text += f"{_LONGEST_PRINT}; print entries of `outputs`, or the steps of `share()`"
            raise UsageError(Notice(code="usage.too-long", text=text))
        return "\n".join(self._write_equations())

    def _write_equations(self) -> Iterator[str]:
        def write(value: Expr | ImmutableDenseMatrix) -> str:
            return str(sympy.latex(value, symbol_names=self.names, mat_str="bmatrix", mat_delim=""))

        for name, value in self.outputs.items():
            left = _OUTPUT_LATEX.get(name) or _LATEX.get(name, name)
            if isinstance(value, tuple):
                for k, matrix in enumerate(value, start=1):
                    yield f"{_write_index(left, str(k))} = {write(matrix)}"
            else:
                yield f"{left} = {write(value)}"

    def _repr_latex_(self) -> str | None:
        """Return the equations for a notebook, None where they are too long."""
        if self.operations > _LONGEST_PRINT:
            return None
        rows = r" \\ ".join(line.replace(" = ", " &= ", 1) for line in self._write_equations())
        return rf"$$\begin{{aligned}} {rows} \end{{aligned}}$$"


def _write_index(letter: str, *indices: str) -> str:
    r"""Return a letter in LaTeX with indices behind those it has: F_v^+ and 1 give F_{v,1}^+."""
    match = _INDEXED.match(letter)
    if match is None:
        return rf"{{{letter}}}_{{{','.join(indices)}}}"
    below = ",".join(part for part in (match["below"], *indices) if part)
    return f"{match['letter']}_{{{below}}}{match['above'] or ''}"


def _list_names(robot: Robot, base: BaseParameters, port: functions.Port) -> list[str]:
    """Return the names of the elements of an input, numbered as the joints are."""
    if port.name in (base.vector, "f"):
        return [entry.name for entry in (base.friction if port.name == "f" else base.parameters)]
    if port.name == "h":
        return [entry.name for entry in functions.list_spring_parameters(robot)]
    if port.name == "z":
        counts = functions.list_bristles(robot)
        placed = ((k + 1, place + 1 if many > 1 else "") for k, many in counts for place in range(many))
        return [f"z{place}_{number}" for number, place in placed]
    numbers = [index + 1 for index in robot.coordinates]
    if port.name in ("P", "Q"):
        return [
            f"{port.name}{place}_{number}"
            for number, joint in zip(numbers, robot.axes, strict=True)
            if joint.elasticity is not None
            for place, _ in enumerate(joint.elasticity.stops, start=1)
        ]
    stem, _, part = port.name.partition("_")
    if part in ("a", "p"):
        # Of joints with a motor, or without one.
        numbers = [numbers[k] for k in (robot.driven if part == "a" else robot.passive)]
        return [f"{stem}{number}" for number in numbers]
    return [f"{port.name}{number}" for number in numbers]


def _shape_outputs(spec: functions.FunctionSpec, rows: Sequence[Sequence[Expr]]) -> dict[str, SymbolicOutput]:
    def shape(port: functions.Port, entries: Sequence[Expr]) -> SymbolicOutput:
        if port.shape == (1,):
            return entries[0]
        if len(port.shape) <= 2:
            return ImmutableDenseMatrix(*(*port.shape, 1)[:2], entries)
        _, rows, columns = port.shape
        size = rows * columns
        starts = range(0, port.size, size)
        return tuple(ImmutableDenseMatrix(rows, columns, entries[k : k + size]) for k in starts)

    return {port.name: shape(port, part) for port, part in zip(spec.outputs, rows, strict=True)}


def derive_symbolic(
    robot: Robot,
    name: str,
    *,
    standard: functions.Standard = False,
    base: BaseParameters | None = None,
    symbols: Mapping[str, Sequence[Expr]] | None = None,
) -> SymbolicFunction:
    """Return a function of the catalogue as exact SymPy expressions.

    Of the routes to the function (recursions, regressors, differentiation of the energy) the one with the
    shortest formulas is taken. Equal robots give equal expressions.

    Args:
        robot: the robot.
        name: of the function, such as "mass_matrix".
        standard: whether it takes the standard parameters in place of beta, see `build_functions`.
        base: the base parameters of `robot` where they are known already.
        symbols: own expressions for inputs, one an element, for example {"q": dynamicsymbols("q1 q2")};
            others are q1.., dq1.., and the names of the parameters (ZZR1).

    Raises:
        UsageError: the catalogue has no such function for this robot, or `symbols` do not fit it.
    """

    def write_latex(symbol: str) -> str:
        """Return a symbol in LaTeX: dq1, Fv2, k1_2; of other names what lessons write."""
        if match := _NUMBERED.match(symbol):
            if whole := _LATEX.get(match["letter"] + match["place"]):
                return _write_index(whole, match["number"])
            if letter := _LATEX.get(match["letter"]):
                return _write_index(letter, *filter(None, (match["place"],)), match["number"])
        return write_name_latex(symbol)

    if standard:
        base = build_standard_parameters(robot, internal=standard == "internal")
    elif base is None:
        base = derive_base_parameters(robot)
    (spec,) = functions.list_robot_specs(robot, base, (name,))
    known, own = [port.name for port in spec.inputs], symbols or {}
    for wrong in (key for key in own if key not in known):
        text = f"symbols: function '{name}' has no input '{wrong}'; it has {', '.join(known)}"
        raise UsageError(Notice(code="usage.unknown-input", text=text))
    inputs = {}
    for port in spec.inputs:
        entries = list(own.get(port.name, map(Symbol, _list_names(robot, base, port))))
        if len(entries) != port.size:
            text = f"symbols: input '{port.name}' of '{name}' has {port.size} elements, got {len(entries)}"
            raise UsageError(Notice(code="usage.wrong-symbols", text=text))
        inputs[port.name] = ImmutableDenseMatrix(port.size, 1, entries)
    workspace = build_workspace(robot, base, spec, exact=True)
    programs = {
        route: workspace.algebra.build_program(spec, workspace.build_outputs(spec, build))
        for route, build in list_routes(robot, name).items()
    }
    sizes = {route: count_expanded_operations(program) for route, program in programs.items()}
    route = min(sizes, key=sizes.__getitem__)
    columns = tuple(map(tuple, inputs.values()))
    numbers = tuple(workspace.algebra.numbers or ())
    source = ExactProgram(program=programs[route], numbers=numbers, inputs=columns)
    values = dict(robot.symbols)
    return SymbolicFunction(
        name=name,
        meaning=spec.meaning,
        inputs=inputs,
        outputs=_shape_outputs(spec, write_values(source)),
        units={port.name: port.unit for port in (*spec.inputs, *spec.outputs)},
        lengths={
            Symbol(length): Rational(repr(values[length])) if length in values else None
            for length in list_symbols(robot)
        },
        operations=sizes[route],
        route=route,
        names={x: write_latex(x.name) for column in columns for x in column if isinstance(x, Symbol)},
        source=source,
    )
