"""What all results of the API have in common: they print themselves, and say what speaks against them.

str(result)             as the command line prints it, with warnings and errors
result.to_dict()        as the command line gives it with --json
result.notices          what a reader should know; result.errors why it is not acceptable
in a notebook           tables, texts and figures
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import TYPE_CHECKING

from symid.errors import Notice

if TYPE_CHECKING:  # a program that prints nothing does without
    from symid.report.blocks import Block

__all__ = ["Progress", "Result", "ignore"]

Progress = Callable[[str], None]
"""Called with a short text on what begins now."""


def ignore(text: str) -> None:
    """Say nothing of what begins."""


class Result(ABC):
    """A result of the API, immutable.

    Example:
        >>> import symid
        >>> base = symid.load("two_link").base
        >>> base
        <BaseSet two_link: 6 base parameters (torque)>
        >>> str(base).splitlines()[0]
        'two_link: 6 base parameters of 20'
        >>> base.to_dict()["count"]
        6
    """

    @property
    @abstractmethod
    def notices(self) -> tuple[Notice, ...]:
        """Return what a reader should know of it."""

    @property
    def errors(self) -> tuple[Notice, ...]:
        """Return why it is not acceptable, such as a gate that was missed; nothing where it is."""
        return ()

    @property
    def accepted(self) -> bool:
        """Return whether nothing makes it unacceptable."""
        return not self.errors

    @abstractmethod
    def summarise(self) -> str:
        """Return the result in a few words, in one line."""

    @abstractmethod
    def blocks(self) -> "tuple[Block, ...]":
        """Return the paragraphs and tables that it is printed as."""

    @abstractmethod
    def to_dict(self) -> dict[str, object]:
        """Return the result in plain types, as `--json` gives it."""

    def opening(self) -> "tuple[Block, ...]":
        """Return what a notebook shows first, such as a verdict."""
        return ()

    def figures(self) -> "tuple[Block, ...]":
        """Return the figures that a notebook shows behind the tables."""
        return ()

    def __repr__(self) -> str:
        """Return the result in one line."""
        return f"<{type(self).__name__} {self.summarise()}>"

    def tell(self) -> str:
        """Return the result as text, without what a reader should know of it."""
        from symid.report.blocks import write_text

        return write_text(self.blocks())

    def __str__(self) -> str:
        """Return the result as the command line prints it: texts and tables, then warnings and errors."""
        said = self._tell_notices()
        return f"{self.tell()}\n\n{said}" if said else self.tell()

    def _tell_notices(self) -> str:
        kinds = [("note" if entry.is_note else "warning", entry) for entry in self.notices]
        return "\n".join(f"{kind}: {entry}" for kind, entry in (*kinds, *(("error", e) for e in self.errors)))

    def _tabulate(self) -> "tuple[Block, ...]":
        """Return what a notebook, which is wider than a terminal, shows in place of `blocks`."""
        return self.blocks()

    def _repr_html_(self) -> str:
        """Return the result for a notebook."""
        from symid.report.blocks import write_html

        said = self._tell_notices()
        blocks = (*self.opening(), *self._tabulate(), *((said,) if said else ()), *self.figures())
        return write_html(blocks, failed=not self.accepted)
