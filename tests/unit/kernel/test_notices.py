"""Which notices are printed, in which order, and what is the same for several logs."""

import re
from typing import get_args

import pytest

from symid.errors import (
    MILD,
    MOST_WARNINGS,
    NOTES,
    SEVERE,
    Notice,
    list_notice_lines,
    merge_notices,
    rank_notice,
    sort_notices,
)
from symid.logs.faults import FaultKind
from tests.architecture.source import PROJECT

LOGS = ("a.csv", "b.csv", "c.csv")


def note(text="columns were converted", **place):
    return Notice(code="log.converted", text=text, **place)


def test_the_table_of_codes_is_of_codes_that_exist():
    texts = "".join(path.read_text(encoding="utf-8") for path in (PROJECT / "symid").rglob("*.py"))
    verdicts = {f"{verb}.{level}" for verb in ("identify", "validate") for level in ("wrong", "doubtful")}
    codes = {*SEVERE, *MILD}
    assert len(codes) == len(SEVERE) + len(MILD)
    assert not codes & NOTES
    written = set(re.findall(r"[\"']([a-z]+\.[a-z-]+)[\"']", texts.partition("SEVERE = (")[0]))
    written |= set(re.findall(r"[\"']([a-z]+\.[a-z-]+)[\"']", texts.partition("MOST_WARNINGS")[2]))
    # Those of faults are put together from their kind.
    faults = {f"log.{kind}" for kind in get_args(FaultKind)}
    assert not codes - written - verdicts - faults


def test_severe_warnings_stand_first_and_equal_ones_keep_their_order():
    vague = Notice(code="identify.poorly-identifiable", text="v")
    sign = Notice(code="log.torque-sign", text="s")
    other = Notice(code="export.spring", text="o")
    doubt = Notice(code="identify.doubtful", text="d")
    given = (note(), vague, other, sign, doubt, vague)
    assert sort_notices(given) == (doubt, sign, other, vague, note())
    assert min(given, key=rank_notice) is doubt
    entries = tuple(Notice(code=f"export.k{k}", text="t") for k in (3, 1, 2))
    assert sort_notices(entries) == entries


def test_what_is_the_same_for_all_logs_is_one_notice():
    notices = [note(file=log, line=4) for log in LOGS]
    (whole,) = merge_notices(notices, LOGS)
    assert str(whole) == "columns were converted (all 3 logs)"
    (some,) = merge_notices(notices[:2], LOGS)
    assert str(some) == "columns were converted (a.csv, b.csv)"
    many = [note(file=f"{k}.csv") for k in range(5)]
    assert str(merge_notices(many)[0]) == "columns were converted (0.csv, 1.csv, 2.csv and 2 more)"
    texts = ("17 of 480 rows were left out", "9 of 300 rows were left out", "1.5e-3 of 2 rows were left out")
    notices = [note(text, file=log) for text, log in zip(texts, LOGS, strict=True)]
    (merged,) = merge_notices(notices, LOGS)
    assert str(merged) == f"a.csv: {texts[0]} (and with other numbers in 2 more files)"
    gaps = [Notice(code="log.gap", text=f"a gap of {k} samples", file="a.csv", line=k) for k in (3, 7)]
    assert merge_notices(gaps) == tuple(gaps)
    plain = [Notice(code="log.gap", text=f"a gap of {k} samples") for k in (3, 7)]
    assert merge_notices(plain) == tuple(plain)
    slow = [note(f"joint 'j{k}': {k} of 9 rows are slow", file="a.csv") for k in (1, 2, 3)]
    (one,) = merge_notices(slow)
    assert str(one) == "a.csv: joint 'j1': 1 of 9 rows are slow (likewise, with other numbers: 'j2', 'j3')"
    names = [note(f"joint 'joint{k}' was turned", file=log) for k, log in zip((1, 2), LOGS, strict=False)]
    assert merge_notices(names) == tuple(names)


@pytest.mark.parametrize(
    ("count", "last"), [(3, ""), (4, "and 1 more warning: HOW"), (6, "and 3 more warnings: HOW")]
)
def test_three_warnings_are_printed_and_the_rest_is_counted(count, last):
    warnings = [Notice(code=f"export.k{k}", text=f"w{k}") for k in range(count)]
    lines = list(list_notice_lines([note(), *warnings], (), "HOW"))
    assert lines[:MOST_WARNINGS] == [("warning", f"w{k}") for k in range(MOST_WARNINGS)]
    assert lines[3:] == [*([("warning", last)] if last else []), ("note", "columns were converted")]
    assert len(list(list_notice_lines([note(), *warnings], (), "HOW", most=None))) == count + 1
