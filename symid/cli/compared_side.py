"""An estimate as one side of a comparison: its values in order, its logs, what speaks against it.

Input: a robot's name, the path of an estimate. Output: `OurSide`.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from symid.cli.identified import Identified, find_identified
from symid.errors import EstimateError, Notice

if TYPE_CHECKING:  # this loads numpy
    from symid.identification.comparison import StatedValues

__all__ = ["OurSide", "read_ours"]

_PATTERN = "identify.pattern"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OurSide:
    """The estimate that the others are compared with, and its values in the order of its base parameters."""

    path: Path
    identified: Identified
    names: tuple[str, ...]
    values: "StatedValues"
    logs: tuple[tuple[str, str], ...]
    notices: tuple[Notice, ...]


def read_ours(name: str, path: Path) -> OurSide:
    """Return the estimate at `path` of the robot called `name`.

    Raises:
        EstimateError: the file cannot be read, is of another model, or says no value.
    """
    found = find_identified(name, path)
    if not found.values:
        text = "it has no value of any base parameter; identify again"
        raise EstimateError(Notice(code="compare.no-values", text=text, file=str(path)))
    raw = _read_raw(path)
    return OurSide(
        path=path,
        identified=found,
        names=tuple(entry.name for entry in found.values),
        values=_state(found),
        logs=_list_logs(found, raw),
        notices=_list_doubts(found, raw, path),
    )


def _read_raw(path: Path) -> Mapping[str, object]:
    # The file was read and found right before.
    data: Mapping[str, object] = json.loads(path.read_text(encoding="utf-8"))
    return data


def _state(found: Identified) -> "StatedValues":
    from symid.identification.comparison import build_stated_values

    values = found.values
    return build_stated_values(
        [entry.value for entry in values], [entry.std for entry in values], found.covariance
    )


def _list_logs(found: Identified, raw: Mapping[str, object]) -> tuple[tuple[str, str], ...]:
    settings = raw.get("settings")
    digests = settings.get("log_digests", ()) if isinstance(settings, Mapping) else ()
    known = list(digests) if isinstance(digests, list) else []
    known += [""] * (len(found.sources) - len(known))
    return tuple((source, str(digest)) for source, digest in zip(found.sources, known, strict=False))


def _list_doubts(found: Identified, raw: Mapping[str, object], path: Path) -> tuple[Notice, ...]:
    """Return what speaks against the deviations of an estimate, and what of it is not compared."""
    notices = raw.get("notices")
    doubts = [
        Notice(code="compare.pattern", text=str(entry.get("text")), file=str(path))
        for entry in (notices if isinstance(notices, list) else ())
        if isinstance(entry, Mapping) and entry.get("code") == _PATTERN
    ]
    if not found.covariance and sum(math.isfinite(entry.std) for entry in found.values) > 1:
        text = (
            "it has no covariance: its values are taken as independent of each other, which chi-square feels"
        )
        doubts.append(Notice(code="compare.no-covariance", text=text, file=str(path)))
    if found.springs or found.rotors:
        text = "base parameters and friction are compared; rotors and springs of elastic joints are not"
        doubts.append(Notice(code="compare.springs", text=text, file=str(path)))
    return tuple(doubts)
