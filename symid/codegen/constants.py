"""Parameters baked into code: values of the robot file in place of arguments.

Input: a model card whose functions take parameters. Output: their values, and functions without them.

Supported: base or standard parameters, rotor inertias of elastic joints, friction.
Not supported: springs; functions of hysteresis take h, so that a spring may be changed without new code.
"""

from collections.abc import Mapping
from dataclasses import replace

from symid.codegen.functions import FunctionSpec, ModelCard, ParameterCard
from symid.errors import Notice, UsageError

__all__ = ["Constants", "drop_constants", "find_constants"]

Constants = Mapping[str, tuple[float, ...]]
"""Values of whole input ports by their name."""


def find_constants(card: ModelCard) -> Constants:
    """Return the values of all parameters that may be baked in.

    Raises:
        UsageError: the robot file does not state all of them.
    """
    vectors: dict[str, tuple[ParameterCard, ...]] = {
        card.vector: card.beta,
        "IA": card.rotors,
        "f": card.friction,
    }
    missing = [entry.name for entries in vectors.values() for entry in entries if entry.value is None]
    if missing:
        text = (
            f"constants: the robot file states no value of {', '.join(missing)}; add the values, or write "
            "what was identified into a robot file with `symid export`"
        )
        raise UsageError(Notice(code="usage.unknown-constants", text=text))
    return {
        name: tuple(entry.value for entry in entries if entry.value is not None)
        for name, entries in vectors.items()
    }


def drop_constants(spec: FunctionSpec, constants: Constants) -> FunctionSpec:
    """Return the function without the inputs that are constants."""
    return replace(spec, inputs=tuple(port for port in spec.inputs if port.name not in constants))
