"""Figures of a result: they show themselves in a notebook, and are written as SVG or HTML.

Input: drawings. Output: `Figures`.
"""

from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, final

if TYPE_CHECKING:
    from symid.report.blocks import Drawing

__all__ = ["Figures"]


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Figures:
    """Figures, each an SVG with a caption.

    Attributes:
        drawings: each with its `svg` and its `caption`.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link")
        >>> fit = robot.identify(robot.simulate(duration=5.0, seed=1).log)
        >>> figures = fit.validate(robot.simulate("tc", duration=5.0, seed=2).log).plot()
        >>> len(figures), figures.save("torques.svg").name
        (2, 'torques.svg')
    """

    drawings: "tuple[Drawing, ...]"

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self.drawings)

    def __repr__(self) -> str:
        """Return the captions in one line."""
        return f"<Figures {'; '.join(entry.caption for entry in self.drawings)}>"

    def _repr_html_(self) -> str:
        """Return the figures for a notebook."""
        from symid.report.blocks import write_html

        return write_html(self.drawings)

    def save(self, path: str | PathLike[str]) -> Path:
        """Write the figures below one another to `path`, .svg or .html, and return the path.

        Raises:
            UsageError: the name ends in something else.
            OutputError: the file cannot be written.
        """
        from symid.errors import Notice, UsageError
        from symid.identification.storage import write_file
        from symid.report.blocks import write_html, write_svg

        file = Path(fspath(path))
        if file.suffix.lower() == ".svg":
            return write_file(file, write_svg(self.drawings))
        if file.suffix.lower() == ".html":
            head = '<!DOCTYPE html><html lang="en"><meta charset="utf-8"><title>Figures</title>'
            return write_file(file, f"{head}<body>{write_html(self.drawings)}</body></html>\n")
        text = f"{file}: figures are written as .svg or .html"
        raise UsageError(Notice(code="usage.suffix", text=text))
