"""How the dynamics of a robot come about, step by step, and what code of them costs.

Input: a robot. Output: `Derivation`.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, final

from symid.api.result import Progress, Result
from symid.errors import Notice

if TYPE_CHECKING:  # these load SymPy
    from symid.codegen.routes import RouteCount
    from symid.report.blocks import Block
    from symid.robot.description import Robot
    from symid.teaching.lesson import Step

__all__ = ["Derivation", "derive_dynamics"]


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Derivation(Result):
    """The derivation of a robot's dynamics; iterate over `steps`.

    Attributes:
        robot: the robot.
        steps: each a title, a sentence, formulas in text and LaTeX, and what was checked.
        operations: of every function and every route that gives it; `chosen` is the one that is written.
        latex: whether it is printed with formulas in LaTeX.

    Example:
        >>> import symid
        >>> lesson = symid.load("emps").derivation()
        >>> [step.title for step in lesson.steps]
        ['Frames', 'Velocities', 'Energy', 'Base parameters', 'Torques']
    """

    robot: "Robot"
    steps: "tuple[Step, ...]"
    operations: "tuple[RouteCount, ...]"
    latex: bool = False

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return what a reader should know of the robot."""
        return self.robot.notices

    def summarise(self) -> str:
        """Return robot and steps."""
        return f"{self.robot.name}: {', '.join(step.title for step in self.steps)}"

    def blocks(self) -> "tuple[Block, ...]":
        """Return the steps, and the operations of generated functions."""
        from symid.report.derivation_text import show_derivation

        return show_derivation(self.steps, self.operations, latex=self.latex)

    def to_dict(self) -> dict[str, object]:
        """Return steps and operations of all routes in plain types."""
        from symid.report.derivation_text import describe_derivation

        return describe_derivation(self.robot.name, self.steps, self.operations)

    def _repr_html_(self) -> str:
        """Return the derivation for a notebook, with formulas."""
        from symid.report.derivation_text import write_derivation_html

        return write_derivation_html(self.steps, self.operations)

    def _repr_latex_(self) -> str:
        """Return the formulas of all steps."""
        from symid.report.derivation_text import write_derivation_latex

        return write_derivation_latex(self.steps)


def derive_dynamics(robot: "Robot", progress: Progress, *, latex: bool = False) -> Derivation:
    """Return the derivation of `robot`; see `Derivation`.

    Raises:
        RobotError: a symbolic length has no value.
    """
    progress(f"deriving the dynamics of {robot.name}")
    from symid.codegen.routes import find_route_counts
    from symid.teaching.lesson import derive_lesson

    steps = derive_lesson(robot)
    progress("counting the operations of all routes to code")
    return Derivation(robot=robot, steps=steps, operations=find_route_counts(robot), latex=latex)
