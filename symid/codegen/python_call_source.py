"""The C file by which a cached library is called from Python without ctypes; see `python_call`.

Input: a model card. Output: C, to be compiled with the library's sources.

Supported: every function of the card. Not supported: float libraries.
"""

from dataclasses import dataclass

from symid.codegen.describe import BANNER
from symid.codegen.functions import FunctionSpec, ModelCard
from symid.codegen.templates import write_template

__all__ = ["CallContext", "CallFunction", "write_python_call"]


@dataclass(frozen=True, slots=True, kw_only=True)
class CallFunction:
    """One function: its name, and its arguments out of one array of pointers."""

    name: str
    arguments: str


@dataclass(frozen=True, slots=True, kw_only=True)
class CallContext:
    """python_call.c.jinja."""

    banner: str
    prefix: str
    functions: tuple[CallFunction, ...]


def _describe(spec: FunctionSpec) -> CallFunction:
    count = len(spec.inputs) + len(spec.outputs)
    return CallFunction(name=spec.name, arguments=", ".join(f"pointers[{k}]" for k in range(count)))


def write_python_call(card: ModelCard, prefix: str) -> str:
    """Return the C source of the calls from Python of all functions of the card."""
    functions = tuple(map(_describe, card.functions))
    return write_template(
        "c/python_call.c.jinja", CallContext(banner=BANNER, prefix=prefix, functions=functions)
    )
