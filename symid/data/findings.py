"""What is found while a log is read: mistakes that stop it, and remarks that go with it.

One collector a file, so that all mistakes are said at once.
"""

from dataclasses import dataclass, field
from typing import final

from symid.errors import Notice

__all__ = ["Findings"]


@final
@dataclass(slots=True, kw_only=True)
class Findings:
    """Mistakes and remarks on the log `file`; it fills while the log is read, and no longer."""

    file: str
    mistakes: list[Notice] = field(default_factory=list)
    remarks: list[Notice] = field(default_factory=list)

    def refuse(self, code: str, text: str) -> None:
        """Note a mistake."""
        self.mistakes.append(Notice(code=code, text=text, file=self.file))

    def remark(self, code: str, text: str) -> None:
        """Note something that the reader should know."""
        self.remarks.append(Notice(code=code, text=text, file=self.file))
