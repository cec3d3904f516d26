"""The extension module by which a cached library is called from Python; see `python_call`.

Input: a model card. Output: C, to be compiled with the library's sources.

Supported: every function of the card. Not supported: float libraries.
"""

from dataclasses import dataclass

from symid.codegen.describe import BANNER
from symid.codegen.functions import FunctionSpec, ModelCard, Port
from symid.codegen.templates import write_template

__all__ = ["CallContext", "CallFunction", "write_python_call"]


@dataclass(frozen=True, slots=True, kw_only=True)
class CallFunction:
    """One function: its name, its arguments out of one array of pointers, and what stands behind these."""

    name: str
    arguments: str
    inputs: int
    outputs: int
    ports: str


@dataclass(frozen=True, slots=True, kw_only=True)
class CallContext:
    """python_call.c.jinja."""

    banner: str
    prefix: str
    most_ports: int
    most_axes: int
    functions: tuple[CallFunction, ...]


def _describe_port(port: Port) -> str:
    return f"{{{len(port.shape)}, {{{', '.join(map(str, port.shape)) or 0}}}, {port.size}}}"


def _describe(spec: FunctionSpec) -> CallFunction:
    ports = (*spec.inputs, *spec.outputs)
    return CallFunction(
        name=spec.name,
        arguments=", ".join(f"pointers[{k}]" for k in range(len(ports))),
        inputs=len(spec.inputs),
        outputs=len(spec.outputs),
        ports=", ".join(map(_describe_port, ports)),
    )


def write_python_call(card: ModelCard, prefix: str) -> str:
    """Return the C source of the calls from Python of all functions of the card."""
    ports = [(*spec.inputs, *spec.outputs) for spec in card.functions]
    context = CallContext(
        banner=BANNER,
        prefix=prefix,
        most_ports=max(map(len, ports)),
        most_axes=max(1, *(len(port.shape) for several in ports for port in several)),
        functions=tuple(map(_describe, card.functions)),
    )
    return write_template("c/python_call.c.jinja", context)
