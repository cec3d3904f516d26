"""What this installation has, what it lacks, and what to do about it.

Input: nothing. Output: `Doctor`.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, final

from symid.api.result import Result
from symid.errors import Notice

if TYPE_CHECKING:
    from symid.report.blocks import Block
    from symid.tasks.installation import Finding

__all__ = ["Doctor", "doctor"]


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Doctor(Result):
    """What was looked at.

    Attributes:
        findings: Python, packages, compiler, calls of compiled code, make, cache, shared files.

    Example:
        >>> import symid
        >>> found = symid.doctor()
        >>> found.findings[0].name
        'python'
    """

    findings: "tuple[Finding, ...]"

    @property
    def missing(self) -> "tuple[Finding, ...]":
        """Return what has a remedy."""
        return tuple(entry for entry in self.findings if entry.remedy)

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return what is missing that symid works without, but slower."""
        return tuple(entry.tell() for entry in self.missing if not entry.needed)

    @property
    def errors(self) -> tuple[Notice, ...]:
        """Return what is missing that symid cannot work without."""
        return tuple(entry.tell() for entry in self.missing if entry.needed)

    def summarise(self) -> str:
        """Return how much there is to do."""
        return f"{len(self.findings)} looked at, {len(self.missing)} to do"

    def blocks(self) -> "tuple[Block, ...]":
        """Return a table."""
        from symid.report.blocks import format_table

        rows = [(entry.name, entry.found, entry.remedy or "ok") for entry in self.findings]
        return (format_table(("what", "found", "to do"), rows, left=(0, 1, 2)),)

    def to_dict(self) -> dict[str, object]:
        """Return the findings in plain types."""
        from symid import __version__

        return {
            "version": __version__,
            "findings": [
                {"name": entry.name, "found": entry.found, "ok": not entry.remedy, "remedy": entry.remedy}
                for entry in self.findings
            ],
        }


def doctor() -> Doctor:
    """Look at Python, packages, compiler, cache and shared files, and say what to do.

    Example:
        >>> import symid
        >>> symid.doctor().accepted
        True
    """
    from symid.tasks.installation import list_findings

    return Doctor(findings=list_findings())
