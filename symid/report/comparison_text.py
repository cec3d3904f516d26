"""A comparison of values with those of others as text, objects for JSON and warnings."""

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from symid.environment import show_path
from symid.errors import Notice
from symid.report.blocks import Block, Table
from symid.serialization import describe_record

if TYPE_CHECKING:
    from symid.dynamics import OpenReading
    from symid.identification import Compared, EstimateSide, TriedReading

_WIDTH = 44
"""Letters of a group on one line of a table."""
_TINY = 1e-12
_TOO_SURE = 0.999
_LIMITS = ((2.0, 0.9545), (3.0, 0.9973))
"""Numbers of deviations, and the share of normal errors within them."""


def show_comparison(ours: "EstimateSide", others: Sequence["Compared"]) -> tuple[Block, ...]:
    """Return for each other the table, counts, chi-square, the largest differences; others stand apart."""
    first, *rest = (_show_compared(ours, found) for found in others)
    return (*first, *(part for head, *parts in rest for part in (f"\n{head}", *parts)))


def _show_compared(ours: "EstimateSide", found: "Compared") -> tuple[Block, ...]:
    other, comparison = found.other, found.comparison
    columns = "" if other.columns is None else f", column {other.columns.value!r}"
    read = any(entry.read_as for entry in found.groups)
    rows = list[Sequence[object]]()
    for value in found.values:
        away = (_format_deviations(value.deviations, "+", 2), *([value.read_as] if read else []))
        rows.append((value.group, value.theirs, value.theirs_std, value.ours, value.ours_std, *away))
    header = ["group", "other", "std", "ours", "std", "in std", *(["read as"] if read else [])]
    lines = ["largest differences"]
    for place in comparison.list_farthest():
        distance = float(comparison.deviations[place])
        mine, theirs = float(comparison.ours.values[place]), float(comparison.theirs.values[place])
        share = f" ({100.0 * (mine - theirs) / abs(theirs):+.3g} %)" if theirs else ""
        lines.append(
            f"  {found.groups[place].text}: ours {mine:.4g} is {_format_deviations(abs(distance))} standard "
            f"deviations {'above' if distance > 0 else 'below'} the other's {theirs:.4g}{share}"
        )
    with_these = " with these" if found.absent or found.neither else ""
    span = f"the groups of the other{with_these} span all base parameters, exactly"
    if found.lacking > 0:
        span = f"besides, the other does not determine {found.lacking} combinations of ours"
    judged, total = comparison.judged, comparison.chi_square
    agreement = ", ".join(
        f"{comparison.count_within(limit)} of {judged} within {limit:g} standard deviations "
        f"({share * judged:.0f} expected)"
        for limit, share in _LIMITS
    )
    if not judged:
        agreement = "neither side states standard deviations: agreement cannot be judged"
    elif total is None:
        agreement += "\nno chi-square: the covariance of the differences is singular"
    else:
        agreement += f"\nchi-square {_format_deviations(total.value)} over {total.freedom} groups"
        if other.shared:
            agreement += "; no probability, because the estimates have logs in common"
        else:
            chance = f"{total.chance:.2g}" if total.chance > _TINY else f"below {_TINY:g}"
            agreement += f", probability {chance}"
            if total.chance > _TOO_SURE:
                agreement += "; too small for independent errors: both may come from the same log"
        if total.stretch > 1.0:
            large = f"{total.stretch:.2g} times as large"
            agreement += f"; it would be as expected with standard deviations {large}"
    left_out = (
        ("ours, not in the other: ", found.absent),
        ("in neither: ", found.neither),
        ("", (span,)),
        ("the other's, refused in ours: ", found.not_ours),
        ("the other's, of another model: ", found.other.strange),
    )
    return (
        f"{ours.identified.robot.name}: {show_path(ours.source)} beside {show_path(other.source)}{columns}",
        Table(header, rows, left=(0, 6) if read else (0,), fold=_WIDTH),
        agreement,
        *(["\n".join(lines)] if len(lines) > 1 else []),
        "\n".join(f"{head}{', '.join(names)}" for head, names in left_out if names),
    )


def _format_deviations(value: float, sign: str = "", digits: int = 1) -> str:
    """Return a number of deviations; beyond a hundred thousand its size is enough."""
    if math.isnan(value):
        return "-"
    return format(value, f"{sign}.{digits}f" if abs(value) < 1e5 else f"{sign}.2e")


def describe_compared(found: "Compared") -> dict[str, object]:
    """Return the comparison with one other as `symid compare --json` gives it."""
    comparison, other = found.comparison, found.other
    total = comparison.chi_square
    chance = None if total is None or other.shared else total.chance
    return {
        "source": show_path(other.source),
        "columns": other.columns and describe_record(other.columns),
        "groups": [
            {**describe_record(value), "line": value.line or None, "read_as": value.read_as or None}
            for value in found.values
        ],
        "judged": comparison.judged,
        "within": {f"{limit:g}": comparison.count_within(limit) for limit, _ in _LIMITS},
        "largest": comparison.largest,
        "chi_square": total and {"value": total.value, "freedom": total.freedom, "probability": chance},
        **{name: getattr(found, name) for name in ("absent", "neither", "lacking", "not_ours")},
        "other_model": other.strange,
        "shared_logs": other.shared,
        "readings": [
            {
                "group": found.groups[reading.group].text,
                "read_as": _write_reading(found, reading)[1],
                "coupling": reading.coupling or None,
                **describe_record(tried),
            }
            for reading, tried in found.readings
        ],
    }


def _write_reading(found: "Compared", reading: "OpenReading") -> tuple[str, str]:
    """Return the term that a group may contain, and how the group is read with it."""
    group, factor = found.groups[reading.group], str(reading.factor)
    term = {"1": reading.name, "-1": f"-{reading.name}"}.get(factor, f"{factor}*{reading.name}")
    sign = "-" if term.startswith("-") else "+"
    return term, f"{group.read_as or group.text} {sign} {term.removeprefix('-')}"


def warn_compared(found: "Compared") -> Iterator[Notice]:
    """Yield the warnings on one other: shared logs, terms that groups seem to contain."""
    file = str(found.other.source)

    def describe(reading: "OpenReading", tried: "TriedReading") -> str:
        return (
            f"{found.groups[reading.group].text} is {_format_deviations(abs(tried.before))} standard "
            f"deviations away as it stands, and {_format_deviations(abs(tried.after))} if it contains "
            f"{_write_reading(found, reading)[0]} too"
        )

    def write_option(reading: "OpenReading") -> str:
        return f'--read-as "{found.groups[reading.group].text} = {_write_reading(found, reading)[1]}"'

    if found.other.shared:
        text = (
            f"both estimates were fitted to {', '.join(found.other.shared)}: their errors are not "
            "independent, and differences should be smaller than deviations; compare fits of other logs"
        )
        yield Notice(code="compare.shared-logs", text=text, file=file)
    for coupling in dict.fromkeys(reading.coupling for reading, _ in found.readings if reading.coupling):
        entries = [entry for entry in found.readings if entry[0].coupling == coupling]
        sure = [entry for entry in entries if entry[1].decisive]
        if not sure:
            continue
        text = (
            f"{'; '.join(describe(*entry) for entry in sure)}. The other seems to count what "
            f"drive {coupling!r} adds to a single joint to that joint (an inference); to compare so: "
            f"{' '.join(write_option(reading) for reading, _ in sure)}"
        )
        undecided = "; ".join(
            f"{write_option(reading)} changes chi-square by {-tried.gain:+.1f}"
            for reading, tried in entries
            if not tried.decisive
        )
        if undecided:
            text += f". The same rule has more terms, on which the values do not decide: {undecided}"
        yield Notice(code="compare.coupled-reading", text=text, file=file)
    for reading, tried in (entry for entry in found.readings if not entry[0].coupling):
        chance = "Only the numbers support this, it may be chance"
        text = f"{describe(reading, tried)}. {chance}; to compare so: {write_option(reading)}"
        yield Notice(code="compare.other-reading", text=text, file=file)
