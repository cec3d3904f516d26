"""Comparisons of fits in memory: against closed forms, and against the same fits as files."""

import dataclasses

import numpy as np
import pytest

import symid
from symid.api.validation import compare_fit
from symid.errors import Notice, UsageError
from symid.identification.stored import write_fit
from tests.estimates import STD, build_estimate
from tests.refusals import raises


@pytest.fixture(scope="module")
def robot():
    return symid.load("two_link").description


def shift(estimate, **shifts):
    """Return an estimate with other values, from another log."""
    return dataclasses.replace(
        estimate,
        sources=("other.npz",),
        parameters=tuple(
            dataclasses.replace(entry, value=entry.value + shifts.get(entry.name, 0.0))
            for entry in estimate.parameters
        ),
    )


def test_a_fit_in_memory_says_what_its_file_says(robot, tmp_path):
    doubt = Notice(code="identify.pattern", text="deviations are up to 2.9 times too small")
    estimate = build_estimate(robot)
    settings = {**estimate.settings, "log_digests": ["beef"]}
    ours = dataclasses.replace(estimate, notices=(doubt,), settings=settings)
    theirs = dataclasses.replace(shift(ours, ZZ2=STD), covariance=(), settings=settings)
    files = [write_fit(entry, tmp_path / f"{k}.json") for k, entry in enumerate((ours, theirs))]
    in_memory, read = compare_fit(robot, ours, [theirs]), compare_fit(robot, files[0], files[1:])
    assert in_memory.groups == read.groups
    assert [note.text for note in in_memory.notices] == [note.text for note in read.notices]
    codes = {"compare.pattern", "compare.no-covariance", "compare.shared-logs"}
    assert {note.code for note in read.notices} == codes


def test_several_others_stand_one_by_one(robot, tmp_path):
    ours = build_estimate(robot)
    table = tmp_path / "table.csv"
    values = {entry.name: entry.value for entry in ours.parameters}
    rows = [f"{name},{value - 3 * STD!r},{STD}" for name, value in values.items()]
    table.write_text("\n".join(["name,value,std", *rows]), encoding="utf-8")
    found = compare_fit(robot, ours, [shift(ours), table])
    first, second = found.others
    assert (first.largest, second.largest) == pytest.approx((0.0, 3 / np.sqrt(2)), abs=1e-9)
    assert found.groups == first.groups + second.groups
    assert found.count_within(2.0) == first.count_within(2.0) == len(values)
    assert second.chi_square.value == pytest.approx(len(values) * 9 / 2)
    assert str(found) == f"{first}\n\n\n{second}"
    with raises(UsageError, "usage.several-others", match="got 2"):
        _ = found.chi_square
    read = compare_fit(robot, ours, [table], read_as={" Fv1 ": "Fv1 + Fv2"})
    assert {value.read_as for value in read.groups} == {"", "Fv1 + Fv2"}


def test_what_is_no_fit_is_refused(robot, tmp_path):
    ours = build_estimate(robot)
    with pytest.raises(TypeError, match="expected a fit or its file, got dict"):
        compare_fit(robot, ours, [{}])
    file = write_fit(ours, tmp_path / "ours.json")
    with raises(UsageError, "usage.same-file", match=r"ours\.json"):
        compare_fit(robot, symid.load_fit(file), [file])
