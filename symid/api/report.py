"""The page of a fit: one self-contained HTML file.

Input: what was written. Output: `FitPage`.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, final

from symid.api.result import Result
from symid.errors import Notice

if TYPE_CHECKING:  # these load NumPy
    from symid.identification.diagnosis import Diagnosis
    from symid.report.blocks import Block
    from symid.report.fit_page import Page

__all__ = ["FitDiagnosis", "FitPage"]


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class FitDiagnosis(Result):
    """What the logs of a fit tell beyond parameters: correlations, bootstrap, drift, structure.

    Attributes:
        robot: its name.
        product: all that was found.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link")
        >>> path = robot.simulate(duration=5.0, seed=1).save("run.npz")
        >>> found = robot.identify(path).diagnose()
        >>> found.product.rank
        12
    """

    robot: str
    product: "Diagnosis"

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return what a reader should know, for example that a log has changed since the fit."""
        return self.product.notices

    def summarise(self) -> str:
        """Return robot and how many parameters are essential."""
        return f"{self.robot}: {len(self.product.essential.kept)} essential parameters"

    def blocks(self) -> "tuple[Block, ...]":
        """Return what was found, in a few sentences and a table of what the residual follows."""
        from symid.report.diagnosis_text import show_diagnosis

        return show_diagnosis(self.product)

    def to_dict(self) -> dict[str, object]:
        """Return the diagnosis in plain types."""
        from symid.report.diagnosis_text import describe_diagnosis

        return describe_diagnosis(self.product)


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class FitPage(Result):
    """A page that was written, and what was found on the way.

    Attributes:
        page: all that was found.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link")
        >>> fit = robot.identify(robot.simulate(duration=5.0, seed=1).log)
        >>> fit.report("report.html").file.name
        'report.html'
    """

    page: "Page"

    @property
    def file(self) -> Path:
        """Return where the page is."""
        return self.page.file

    @property
    def diagnosis(self) -> "Diagnosis | None":
        """Return what the logs of the fit tell, None where that was not asked for."""
        return self.page.diagnosis

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return what a reader should know."""
        return self.page.notices

    def summarise(self) -> str:
        """Return where the page is."""
        return str(self.file)

    def blocks(self) -> "tuple[Block, ...]":
        """Return where the page is, how logs were processed, and the diagnosis."""
        from symid.paths import show_path
        from symid.report.diagnosis_text import show_diagnosis

        head = "\n".join((f"report: {show_path(self.file)}", *self.page.lines))
        return (head, *(() if self.diagnosis is None else show_diagnosis(self.diagnosis)))

    def to_dict(self) -> dict[str, object]:
        """Return what was written and tried in plain types."""
        from symid.report.diagnosis_text import describe_diagnosis

        page = self.page
        found: dict[str, object] = {"robot": page.robot, "file": page.file, "validations": page.sources}
        if page.processing is not None:
            found["processing"] = page.processing
        if page.diagnosis is not None:
            found["diagnosis"] = describe_diagnosis(page.diagnosis)
        return found
