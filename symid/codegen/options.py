"""What can be chosen about generated sources."""

from dataclasses import dataclass

from symid.errors import Notice, UsageError

__all__ = ["BACKENDS", "GenerateOptions"]

BACKENDS = ("auto", "c", "python", "casadi")
"""What can compute a robot's functions; "auto" is C, or NumPy where there is no compiler."""

_PRECISIONS = ("double", "float")
_TRIGONOMETRIES = ("own", "library")


@dataclass(frozen=True, slots=True, kw_only=True)
class GenerateOptions:
    """Choices for generated code.

    Args:
        precision: "double" or "float", the type of every number in the C library.
        trigonometry: "own" for sines and cosines of all angles at once, in the generated C itself;
            "library" for calls of the C library's.
        states: how many random states the self-test evaluates.
        seed: of the generator that draws them.
        friction_laws: whether the C library holds all static friction laws besides.

    Raises:
        UsageError: a value that is not offered.
    """

    precision: str = "double"
    trigonometry: str = "own"
    states: int = 100
    seed: int = 1
    friction_laws: bool = False

    def __post_init__(self) -> None:
        """Check the values."""
        if self.precision not in _PRECISIONS:
            text = f"precision: expected one of {', '.join(_PRECISIONS)}, got {self.precision!r}"
            raise UsageError(Notice(code="usage.precision", text=text))
        if self.trigonometry not in _TRIGONOMETRIES:
            text = f"trigonometry: expected one of {', '.join(_TRIGONOMETRIES)}, got {self.trigonometry!r}"
            raise UsageError(Notice(code="usage.trigonometry", text=text))
        if self.states < 1:
            text = f"states: expected at least one, got {self.states}"
            raise UsageError(Notice(code="usage.states", text=text))
