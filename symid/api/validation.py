"""What a fit explains of a log that it was not fitted to: residuals, a gate, figures.

Input: a trial. Output: `LogValidation`.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, final

from symid.api.arguments import check_positive
from symid.api.figures import Figures
from symid.api.result import Result
from symid.errors import Notice

if TYPE_CHECKING:  # these load NumPy
    from symid.estimators.estimate import Residual
    from symid.report.blocks import Block
    from symid.tasks.validate import Trial

__all__ = ["LogValidation"]


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LogValidation(Result):
    """What a fit explains of a log; nothing was fitted to it.

    Attributes:
        product: all that was found.
        gate: percent, the largest acceptable mean of the relative residuals; None for none.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link")
        >>> fit = robot.identify(robot.simulate(duration=5.0, seed=1).log)
        >>> validation = fit.validate(robot.simulate("tc", duration=5.0, seed=2).log, gate=5.0)
        >>> validation.accepted, validation.mean_relative_percent < 1.0
        (True, True)
    """

    product: "Trial"
    gate: float | None = None

    def __post_init__(self) -> None:
        """Refuse a gate that is no positive number.

        Raises:
            UsageError: it is none.
        """
        check_positive("gate", self.gate)

    @property
    def source(self) -> str:
        """Return the log."""
        return self.product.source

    @property
    def residual(self) -> "tuple[Residual, ...]":
        """Return what is left of the torque, joint by joint."""
        return self.product.residual

    @property
    def mean_relative_percent(self) -> float:
        """Return the mean over joints of `100 |tau - tau_predicted| / |tau|`."""
        return self.product.mean_relative_percent

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return what a reader should know, for example that the log is one of the fit."""
        return self.product.notices

    @property
    def errors(self) -> tuple[Notice, ...]:
        """Return why the gate was missed; nothing where it was not, or there was none."""
        return self.product.find_missed(self.gate)

    def summarise(self) -> str:
        """Return the log and the mean relative residual."""
        reached = f"mean relative residual {self.mean_relative_percent:.4f} %"
        return f"{self.product.robot.name} on {self.source}: {reached}"

    def blocks(self) -> "tuple[Block, ...]":
        """Return the headline and the tables of residuals."""
        from symid.report.validation_text import show_trial

        return show_trial(self.product)

    def to_dict(self) -> dict[str, object]:
        """Return residuals, processing and gate in plain types."""
        from symid.report.validation_text import describe_trial

        return {**describe_trial(self.product), "gate": self.gate, "accepted": self.accepted}

    def figures(self) -> "tuple[Block, ...]":
        """Return measured and predicted torques; of elastic joints their hysteresis loops."""
        return self.plot().drawings

    def plot(self) -> Figures:
        """Return the figures, which show themselves in a notebook; `.save(path)` writes them as SVG."""
        from symid.report.validation_text import draw_trial

        return Figures(drawings=draw_trial(self.product))
