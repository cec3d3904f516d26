"""What a search for the parameters of a friction law ends with, before its uncertainty is known.

Output: `FrictionSearch`, of every estimator alike.

Supported: deterministic and stochastic searches. Not supported: time spent, which is measured elsewhere.
"""

from dataclasses import dataclass

from symid.arrays import FloatArray, freeze
from symid.friction.estimate import FrictionOutcome

__all__ = ["FrictionSearch"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrictionSearch:
    """The end of a search.

    Args:
        linear: (p,) and shape: (s,) found; objective: J there.
        evaluations: how often J was found; solves: linear problems solved; iterations: or generations.
        history: the least J after each of them.
        outcome: how it ended; `ended` the stop rule that held, in words.
        settings: what the search tells of itself.
    """

    linear: FloatArray
    shape: FloatArray
    objective: float
    evaluations: int
    solves: int
    iterations: int
    history: tuple[float, ...]
    outcome: FrictionOutcome
    ended: str
    settings: tuple[tuple[str, float | int | str], ...] = ()

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("linear", "shape"):
            object.__setattr__(self, name, freeze(getattr(self, name)))
