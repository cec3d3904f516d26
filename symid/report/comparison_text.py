"""What a comparison of values found: tables and sentences for people, an object for programs.

Input: `Compared`. Output: blocks, dictionaries, notices.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from symid.errors import Notice
from symid.paths import show_path
from symid.report.blocks import Block, format_table

if TYPE_CHECKING:  # these load SymPy
    from symid.identification.comparison import TriedReading
    from symid.parameters.readings import OpenReading
    from symid.tasks.compared import Compared
    from symid.tasks.compared_side import EstimateSide

__all__ = ["describe_comparison", "show_comparison", "warn_comparison"]

_WIDTH = 44
_TINY = 1e-12
_TOO_SURE = 0.999
_LIMITS = ((2.0, 0.9545), (3.0, 0.9973))
"""Numbers of deviations, and the share of normal errors within them."""


def show_comparison(ours: "EstimateSide", others: Sequence["Compared"]) -> tuple[Block, ...]:
    """Return for each other the table, counts, chi-square, the largest differences; others stand apart."""
    first, *rest = (_show_compared(ours, found) for found in others)
    return (*first, *(part for (head, *parts) in rest for part in (f"\n{head}", *parts)))


def _show_compared(ours: "EstimateSide", found: "Compared") -> tuple[Block, ...]:
    other, comparison = found.other, found.comparison
    columns = "" if other.columns is None else f", column {other.columns.value!r}"
    read = any(entry.read_as for entry in found.groups)
    rows = [
        [
            _shorten(value.group),
            _write(value.theirs),
            _write(value.theirs_std),
            _write(value.ours),
            _write(value.ours_std),
            _write(value.deviations, _choose_form(value.deviations, "+.2f")),
            *([_shorten(value.read_as)] if read else []),
        ]
        for value in found.values
    ]
    header = ["group", "other", "std", "ours", "std", "in std", *(["read as"] if read else [])]
    farthest = [_say_difference(found, k) for k in comparison.list_farthest()]
    return (
        f"{ours.identified.robot.name}: {show_path(ours.source)} beside {show_path(other.source)}{columns}",
        format_table(header, rows, left=(0, 6)),
        "\n".join(_count(found)),
        *(["largest differences\n" + "\n".join(f"  {text}" for text in farthest)] if farthest else []),
        "\n".join(_say_left_out(found)),
    )


def _shorten(text: str) -> str:
    return text if len(text) <= _WIDTH else f"{text[: _WIDTH - 3]}..."


def _write(value: float, form: str = ".5g") -> str:
    return format(value, form) if _is_known(value) else "-"


def _choose_form(value: float, form: str) -> str:
    """Return the form of a number of deviations: beyond a hundred thousand its size is enough."""
    return form if abs(value) < 1e5 else "+.2e" if form.startswith("+") else ".2e"


def _write_size(value: float) -> str:
    return format(abs(value), _choose_form(value, ".1f"))


def _is_known(value: float) -> bool:
    # NaN, what is not known, is not itself.
    return bool(value == value)  # noqa: PLR0124


def _count(found: "Compared") -> list[str]:
    """Return how many groups agree, and chi-square."""
    comparison = found.comparison
    judged = comparison.judged
    if not judged:
        return ["no deviation is known on either side: nothing can be judged"]
    counts = [
        f"{comparison.count_within(limit)} of {judged} within {limit:g} deviations "
        f"({share * judged:.0f} expected)"
        for limit, share in _LIMITS
    ]
    lines = [", ".join(counts)]
    total = comparison.chi_square
    if total is None:
        return [*lines, "no chi-square: the covariances make some combination exact"]
    text = f"chi-square {_write_size(total.value)} over {total.freedom} groups"
    if found.other.shared:
        text += "; with logs in common it has no probability"
    else:
        text += (
            f", probability {total.chance:.2g}" if total.chance > _TINY else f", probability below {_TINY:g}"
        )
        if total.chance > _TOO_SURE:
            text += "; that is less than independent errors give: both may come from the same log"
    if total.stretch > 1.0:
        text += f"; it would be as expected with deviations {total.stretch:.2g} times as large"
    return [*lines, text]


def _say_difference(found: "Compared", place: int) -> str:
    """Return a difference in words."""
    comparison = found.comparison
    away = float(comparison.deviations[place])
    ours, theirs = float(comparison.ours.values[place]), float(comparison.theirs.values[place])
    share = f" ({100.0 * (ours - theirs) / abs(theirs):+.3g} %)" if theirs else ""
    side = "above" if away > 0 else "below"
    return (
        f"{_shorten(found.groups[place].text)}: ours {ours:.4g} is {_write_size(away)} deviations {side} "
        f"the other's {theirs:.4g}{share}"
    )


def _say_left_out(found: "Compared") -> list[str]:
    """Return what one side has and the other has not."""
    lines = []
    if found.absent:
        lines.append(f"ours, not in the other: {', '.join(found.absent)}")
    if found.neither:
        lines.append(f"in neither: {', '.join(found.neither)}")
    if found.lacking > 0:
        lines.append(f"besides, {found.lacking} combinations of ours are not told by the other")
    else:
        with_these = " with these" if found.absent or found.neither else ""
        lines.append(f"the groups of the other{with_these} span all base parameters, exactly")
    if found.not_ours:
        lines.append(f"the other's, refused in ours: {', '.join(found.not_ours)}")
    if found.other.strange:
        lines.append(f"the other's, of another model: {', '.join(found.other.strange)}")
    return lines


def describe_comparison(
    ours: "EstimateSide", others: Sequence["Compared"], gate: float | None, *, accepted: bool
) -> dict[str, object]:
    """Return the comparison as `symid compare --json` gives it."""
    return {
        "robot": ours.identified.robot.name,
        "estimate": show_path(ours.source),
        "others": [_describe_compared(found) for found in others],
        "gate": gate,
        "accepted": accepted,
    }


def _describe_compared(found: "Compared") -> dict[str, object]:
    comparison, other = found.comparison, found.other
    total = comparison.chi_square
    return {
        "source": show_path(other.source),
        "columns": None
        if other.columns is None
        else {
            "name": other.columns.name,
            "value": other.columns.value,
            "deviation": other.columns.deviation,
            "percent": other.columns.percent,
        },
        "groups": [
            {
                "group": value.group,
                "line": value.line or None,
                "read_as": value.read_as or None,
                "unit": value.unit,
                "other": value.theirs,
                "other_std": value.theirs_std,
                "ours": value.ours,
                "ours_std": value.ours_std,
                "difference": value.difference,
                "deviations": value.deviations,
            }
            for value in found.values
        ],
        "judged": comparison.judged,
        "within": {f"{limit:g}": comparison.count_within(limit) for limit, _ in _LIMITS},
        "largest": comparison.largest,
        "chi_square": None
        if total is None
        else {
            "value": total.value,
            "freedom": total.freedom,
            "probability": None if other.shared else total.chance,
        },
        "absent": found.absent,
        "neither": found.neither,
        "lacking": found.lacking,
        "not_ours": found.not_ours,
        "other_model": other.strange,
        "shared_logs": other.shared,
        "readings": [_describe_reading(found, *entry) for entry in found.readings],
    }


def _describe_reading(found: "Compared", reading: "OpenReading", tried: "TriedReading") -> dict[str, object]:
    return {
        "group": found.groups[reading.group].text,
        "read_as": _write_reading(found, reading),
        "coupling": reading.coupling or None,
        "before": tried.before,
        "after": tried.after,
        "gain": tried.gain,
        "log_ratio": tried.log_ratio,
        "decisive": tried.decisive,
    }


def _write_reading(found: "Compared", reading: "OpenReading") -> str:
    group = found.groups[reading.group]
    text, factor = group.read_as or group.text, str(reading.factor)
    sign = "-" if factor.startswith("-") else "+"
    size = factor.removeprefix("-")
    return f"{text} {sign} {reading.name if size == '1' else f'{size}*{reading.name}'}"


def warn_comparison(ours: "EstimateSide", others: Sequence["Compared"]) -> tuple[Notice, ...]:
    """Return what a reader must know: doubts of both sides, shared logs, terms that groups seem to hold."""
    # What was restored from one estimate says nothing of a comparison.
    notices = [note for note in ours.identified.robot.notices if note.code != "estimate.settings-differ"]
    for found in others:
        notices += [*ours.notices, *found.other.notices, *_warn_compared(found)]
    return tuple(dict.fromkeys(notices))


def _warn_compared(found: "Compared") -> tuple[Notice, ...]:
    file = str(found.other.source)
    notices = []
    if found.other.shared:
        text = (
            f"both estimates were fitted to {', '.join(found.other.shared)}, so that their errors are not "
            "independent: differences are of the methods, and should be smaller than the deviations say"
        )
        notices.append(Notice(code="compare.shared-logs", text=text, file=file))
    couplings = dict.fromkeys(reading.coupling for reading, _ in found.readings if reading.coupling)
    for coupling in couplings:
        entries = [entry for entry in found.readings if entry[0].coupling == coupling]
        if any(tried.decisive for _, tried in entries):
            notices.append(_say_coupled(found, coupling, entries))
    for reading, tried in found.readings:
        if not reading.coupling:
            text = (
                f"{_say_tried(found, reading, tried)}; nothing but the numbers speaks for it, which chance "
                f"may do too; to compare so: {_write_option(found, reading)}"
            )
            notices.append(Notice(code="compare.other-reading", text=text, file=file))
    return tuple(notices)


def _say_coupled(
    found: "Compared", coupling: str, entries: Sequence[tuple["OpenReading", "TriedReading"]]
) -> Notice:
    """Return what the drive `coupling` explains."""
    sure = [entry for entry in entries if entry[1].decisive]
    rest = [entry for entry in entries if not entry[1].decisive]
    text = (
        f"{'; '.join(_say_tried(found, *entry) for entry in sure)}: as where drive {coupling!r} is written "
        "with its cross terms alone, and what it adds to each joint by itself is counted to that joint. This "
        f"is an inference; to compare so: {' '.join(_write_option(found, reading) for reading, _ in sure)}"
    )
    if rest:
        undecided = "; ".join(
            f"{_write_option(found, reading)} changes chi-square by {-tried.gain:+.1f}"
            for reading, tried in rest
        )
        text += f". The same rule has more, on which the values do not decide: {undecided}"
    return Notice(code="compare.coupled-reading", text=text, file=str(found.other.source))


def _say_tried(found: "Compared", reading: "OpenReading", tried: "TriedReading") -> str:
    name = found.groups[reading.group].text
    return (
        f"{name} is {_write_size(tried.before)} deviations away as it stands, and "
        f"{_write_size(tried.after)} if it holds {_write_term(reading)} too"
    )


def _write_term(reading: "OpenReading") -> str:
    factor = str(reading.factor)
    return {"1": reading.name, "-1": f"-{reading.name}"}.get(factor, f"{factor}*{reading.name}")


def _write_option(found: "Compared", reading: "OpenReading") -> str:
    group = found.groups[reading.group]
    return f'--read-as "{group.text} = {_write_reading(found, reading)}"'
