"""Fits of friction as files: read back as they were; broken files are refused with what is wrong."""

import json
from dataclasses import replace

import pytest

from symid.errors import EstimateError, OutputError
from symid.friction.estimators import fit_friction
from symid.friction.storage import build_document, read_friction, write_friction
from tests.frictions import draw_s1, draw_s2


def test_what_was_written_is_read(tmp_path):
    estimates = tuple(fit_friction(*draw()) for draw in (draw_s1, draw_s2))
    path = write_friction(estimates, tmp_path / "friction.json")
    assert read_friction(path) == estimates


def test_infinite_numbers_survive(tmp_path):
    estimate = replace(fit_friction(*draw_s1()), aicc=float("inf"))
    assert read_friction(write_friction([estimate], tmp_path / "friction.json")) == (estimate,)


def change(document, **fields):
    document["estimates"][0] |= fields
    return document


@pytest.mark.parametrize(
    ("spoil", "word"),
    [
        (lambda _: [], "no fit of friction"),
        (lambda d: d | {"version": 9}, "version 9"),
        (lambda d: d | {"estimates": 1}, "expected a list"),
        (lambda d: d | {"estimates": [1]}, "expected a table"),
        (lambda d: change(d, joint=1), "expected text"),
        (lambda d: change(d, sigma="x"), "expected a number"),
        (lambda d: change(d, samples=-1), "expected a count"),
        (lambda d: change(d, outcome="FINE"), "outcome"),
        (lambda d: change(d, parameters=[{"name": "fC"}]), "parameters"),
        (lambda d: change(d, settings=[["a", None]]), "number or text"),
        (lambda d: change(d, colour="red"), "colour is unknown"),
    ],
)
def test_a_broken_file_is_refused(tmp_path, spoil, word):
    document = build_document([fit_friction(*draw_s1())])
    path = tmp_path / "friction.json"
    path.write_text(json.dumps(spoil(document)), encoding="utf-8")
    with pytest.raises(EstimateError, match=word) as refused:
        read_friction(path)
    assert {notice.code for notice in refused.value.notices} == {"friction.format"}


def test_what_is_no_json_is_refused(tmp_path):
    path = tmp_path / "friction.json"
    with pytest.raises(EstimateError, match="cannot be read"):
        read_friction(path)
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(EstimateError, match="text file"):
        read_friction(path)
    path.write_text("{", encoding="utf-8")
    with pytest.raises(EstimateError, match="not JSON"):
        read_friction(path)


def test_a_missing_folder_is_refused(tmp_path):
    with pytest.raises(OutputError, match="folder"):
        write_friction([fit_friction(*draw_s1())], tmp_path / "no" / "friction.json")
