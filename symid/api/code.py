"""Functions of a robot as code: written to a folder, or compiled and called from Python.

Robot -> `WrittenCode`; robot -> `CompiledModel`, with one attribute for each function.

    lib = robot.compile()
    M = lib.mass_matrix(q, lib.beta)            one sample (n,) or a batch (N, n)
    T, V = lib.energy(q, dq, lib.beta)          several outputs, also by name: lib.energy(...).T
    torque = lib.inverse_dynamics.bind()        for loops of one sample at a time

Supported: every function of the catalogue that the robot has.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import ArrayLike

from symid import codegen, report, robot as robots
from symid.api.result import RecordResult
from symid.arrays import FloatArray
from symid.environment import show_path
from symid.errors import Notice, UsageError
from symid.serialization import describe_record


@final
class WrittenCode(RecordResult, codegen.GeneratedFolder):
    """A folder of generated code, independent of symid.

    Attributes:
        robot: the robot; None for an element with hysteresis.
        folder: the folder.
        manifest: what it says of itself.
        record: of its build and self-test, with sizes.
        unchanged: whether the folder was already up to date.
        springs: folders in this one, of springs that no function of the robot has.
        notices: warnings and notes on the robot, and that the self-test was not run.

    Example:
        >>> import symid
        >>> written = symid.load("two_link").write("python", "gravity_only", functions=["gravity"])
        >>> written.operations["gravity"]["trig"]
        4
        >>> written.selftest
        'passed'
    """

    robot: "robots.Robot | None"
    notices: tuple[Notice, ...] = ()

    @property
    def selftest(self) -> str:
        """Return the result of its self-test: "passed", or "not run" without a compiler."""
        return self.record.selftest

    def summarise(self) -> str:
        """Return the folder, what was written, and the result of its self-test."""
        return _summarise(self)

    def blocks(self) -> "tuple[report.Block, ...]":
        """Return a headline, and the operations and sizes of every function."""
        sizes = {name: describe_record(size) for name, size in self.record.sizes.items()}
        counted, measured = ("mul", "add", "trig"), ("code", "stack") if sizes else ()
        rows = [
            (
                name,
                *(counts[key] for key in counted),
                *(sizes[name][key] for key in measured if name in sizes),
            )
            for name, counts in self.operations.items()
        ]
        guide = show_path(self.folder / "README.md")
        text = f"next: {guide} says how to use it; symid export ROBOT -o FILE.h writes its parameters"
        return (
            _summarise(self),
            report.Table(("function", *counted, *measured), rows),
            *(["code and stack in bytes; batches in manifest.json"] if sizes else []),
            *(f"spring: {_summarise(spring)}" for spring in self.springs),
            *([text] if self.manifest["target"] == "c" else []),
        )

    def _describe(self) -> dict[str, object]:
        record = self.record
        return {
            "robot": "" if self.robot is None else self.robot.name,
            "target": self.manifest["target"],
            "folder": str(self.folder),
            "files": [str(path) for path in self.files],
            "operations": self.operations,
            "selftest": record.selftest,
            "runner": record.runner,
            "flags": record.flags,
            "sizes": {name: describe_record(size) for name, size in record.sizes.items()},
            "unchanged": self.unchanged,
            "springs": [str(spring.folder) for spring in self.springs],
        }


def _summarise(made: "codegen.GeneratedFolder") -> str:
    state = "nothing has changed" if made.unchanged else f"{len(made.files)} files"
    head = f"{made.folder}: {state}, self-test {made.record.selftest}"
    return head + (f" with {made.record.runner} {made.record.flags}".rstrip() if made.record.runner else "")


@final
class Outputs(tuple[FloatArray, ...]):  # noqa: SLOT001  every one has its own names
    """Several outputs of a function: a tuple, with names as attributes."""

    names: tuple[str, ...]

    def __getattr__(self, name: str) -> FloatArray:
        names: tuple[str, ...] = self.__dict__.get("names", ())
        if name not in names:
            message = f"there is no output {name!r}; there are {', '.join(names)}"
            raise AttributeError(message)
        return self[names.index(name)]

    def __repr__(self) -> str:
        pairs = zip(self.names, self, strict=True)
        return f"Outputs({', '.join(f'{name}={value!r}' for name, value in pairs)})"


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class _Function:
    """A function of a robot, compiled where it is first called.

    Attributes:
        spec: name, meaning, inputs and outputs with shapes and units.
        obtain: returns the library that has it.
    """

    spec: "codegen.FunctionSpec"
    obtain: "Callable[[], codegen.Library]"

    def __repr__(self) -> str:
        """Return the call in one line, with the shapes of one sample."""
        inputs, outputs = (
            ", ".join(f"{port.name}{list(port.shape)}" for port in ports)
            for ports in (self.spec.inputs, self.spec.outputs)
        )
        return f"<{self.spec.name}({inputs}) -> {outputs}: {self.spec.meaning}>"

    def bind(self, *, out: Sequence[FloatArray] | None = None) -> "codegen.Call":
        """Return the function for one sample at a time, with little overhead; it always returns a tuple.

        A bound function is for one thread.

        Args:
            out: float64 arrays for the outputs of every call; None for new ones.

        Raises:
            UsageError: `out` does not fit the outputs.
        """
        return self.obtain().bind(self.spec.name, out=out)

    def _evaluate(
        self, inputs: tuple[Any, ...], out: Sequence[FloatArray] | None, threads: int
    ) -> tuple[FloatArray, ...]:
        return self.obtain().evaluate(self.spec.name, *inputs, out=out, threads=threads)


@final
class RobotFunction(_Function):
    """A compiled function with one output.

    Example:
        >>> import symid
        >>> lib = symid.load("two_link").compile()
        >>> lib.mass_matrix
        <mass_matrix(q[2], beta[6]) -> M[2, 2]: joint-space mass matrix, rotor inertias included>
        >>> lib.mass_matrix([0.0, 0.0], lib.beta).round(3).tolist()
        [[1.103, 0.244], [0.244, 0.081]]
    """

    __slots__ = ()

    def __call__(self, *inputs: ArrayLike, out: FloatArray | None = None, threads: int = 1) -> FloatArray:
        """Return the output for one sample, or for a batch.

        Args:
            inputs: in the order of `spec.inputs`: (n,) each, or (N, n) for N samples; vectors of parameters
                are shared by all samples. SI units, angles in rad.
            out: float64 array for the output; None for a new one.
            threads: that share a batch of compiled C; the output is the same bytes with any number.

        Raises:
            UsageError: an input has a wrong shape or is not real, `out` does not fit the output, or there is
                no thread.
        """
        return self._evaluate(inputs, None if out is None else (out,), threads)[0]


@final
class TupleFunction(_Function):
    """A compiled function with several outputs.

    Example:
        >>> import symid
        >>> lib = symid.load("two_link").compile()
        >>> energy = lib.energy([0.0, 0.0], [1.0, 0.0], lib.beta)
        >>> energy.names
        ('T', 'V')
        >>> energy.T.shape, energy.T.round(2).tolist()
        ((1,), [0.55])
    """

    __slots__ = ()

    def __call__(
        self, *inputs: ArrayLike, out: Sequence[FloatArray] | None = None, threads: int = 1
    ) -> Outputs:
        """Return the outputs for one sample, or for a batch, in order and by name.

        `inputs`, `threads` and errors are those of `RobotFunction`; `out` has an array of float64 for each.
        """
        found = Outputs(self._evaluate(inputs, out, threads))
        found.names = tuple(port.name for port in self.spec.outputs)
        return found


@final
class CompiledModel:
    """Compiled functions of a robot as attributes; returned by `RobotModel.compile`.

    Attributes:
        card: the model: names, units, groupings and reasons of its parameters.
        functions: names of the functions.
        backend: what computes them: "c", "python" or "casadi".
        notices: warnings and notes, for example that there is no compiler.

    Example:
        >>> import symid
        >>> lib = symid.load("two_link").compile()
        >>> lib.functions[:3]
        ('forward_kinematics', 'jacobian', 'mass_matrix')
        >>> lib.gravity([0.1, 0.2], lib.beta).shape
        (2,)
        >>> lib.gravity([[0.1, 0.2]] * 1000, lib.beta).shape
        (1000, 2)
    """

    forward_kinematics: TupleFunction
    jacobian: RobotFunction
    mass_matrix: RobotFunction
    coriolis_matrix: RobotFunction
    gravity: RobotFunction
    bias: RobotFunction
    inverse_dynamics: RobotFunction
    forward_dynamics: RobotFunction
    partial_inverse_dynamics: TupleFunction
    partial_forward_dynamics: RobotFunction
    inverse_dynamics_derivatives: TupleFunction
    forward_dynamics_derivatives: TupleFunction
    mass_matrix_derivatives: RobotFunction
    energy: TupleFunction
    energy_regressor: TupleFunction
    momentum_regressor: RobotFunction
    lagrange_regressor: RobotFunction
    torque_regressor: RobotFunction
    slotine_li_regressor: RobotFunction
    friction: RobotFunction
    friction_regressor: RobotFunction
    friction_step: TupleFunction
    hysteresis_step: TupleFunction
    hysteresis_inverse_step: TupleFunction
    elastic_inverse_dynamics: TupleFunction

    def __init__(self, robot: "robots.Robot", prepare: "Callable[[str], codegen.Library]") -> None:
        prepare = cache(prepare)
        # One function shows what computes them all, or why nothing can.
        first = prepare("forward_kinematics")
        specs = codegen.list_robot_specs(robot, first.card)
        self.card, self.functions = replace(first.card, functions=specs), tuple(spec.name for spec in specs)
        self.backend, self.notices = first.backend, first.notices
        for spec in specs:
            # Of springs without stops a step has the torque alone; the type is that of the name all the same.
            kind = CompiledModel.__annotations__[spec.name]
            setattr(self, spec.name, kind(spec=spec, obtain=partial(prepare, spec.name)))

    @property
    def beta(self) -> FloatArray:
        """Return the base parameters with the robot file's values: (b,), SI units.

        Raises:
            UsageError: the robot file does not state all of them; the message lists the missing ones.
        """
        return self._take_values("beta", self.card.beta)

    @property
    def f(self) -> FloatArray:
        """Return the friction parameters with the robot file's values: (p,), SI units.

        Raises:
            UsageError: the robot file does not state all of them; the message lists the missing ones.
        """
        return self._take_values("f", self.card.friction)

    @property
    def h(self) -> FloatArray:
        """Return the parameters of the springs with the robot file's values, SI units, as `f`."""
        return self._take_values("h", self.card.springs)

    @property
    def IA(self) -> FloatArray:
        """Return the rotor inertias of elastic joints on the joint side, (n,) kg m^2, as `f`."""
        return self._take_values("IA", self.card.rotors)

    def _take_values(self, letter: str, entries: "Sequence[codegen.ParameterCard]") -> FloatArray:
        missing = ", ".join(entry.name for entry in entries if entry.value is None)
        if missing:
            text = f"{letter}: the robot file of {self.card.robot!r} does not state the values of {missing}"
            raise UsageError(Notice(code="usage.no-values", text=text))
        return np.array([entry.value for entry in entries], dtype=np.float64)

    def __repr__(self) -> str:
        """Return robot, functions and backend in one line."""
        return f"<CompiledModel {self.card.robot}: {len(self.functions)} functions, {self.backend}>"

    if not TYPE_CHECKING:  # what is annotated above is all there is

        def __getattr__(self, name: str) -> object:
            """Refuse an unknown function, with the nearest names."""
            if name.startswith("_") or "card" not in self.__dict__:
                raise AttributeError(name)
            hint = robots.suggest_names(name, self.functions, otherwise="there are")
            message = f"{self.card.robot!r} has no function {name!r}: {hint}"
            raise AttributeError(message)
