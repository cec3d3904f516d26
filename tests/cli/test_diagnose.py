"""`validate --band` and `report --diagnose`: what a fit and its logs tell beyond the parameters."""

import json
from html.parser import HTMLParser

import pytest

from symid.cli.main import run


def call_json(capsys, *arguments):
    """Run a verb with --json; return its exit code and the object."""
    code = run([*map(str, arguments), "--json"])
    return code, json.loads(capsys.readouterr().out)


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """Return two logs of two_link with noisy sensors."""
    folder = tmp_path_factory.mktemp("logs")
    paths = []
    for seed in (3, 4):
        paths.append(folder / f"run{seed}.npz")
        arguments = ["simulate", "two_link", "-o", str(paths[-1]), "--noise", "0.5", "--seed", str(seed)]
        assert run([*arguments, "-q"]) == 0
    return paths


@pytest.fixture(scope="module")
def estimate(logs):
    """Return the estimate from the first log."""
    path = logs[0].parent / "estimate.json"
    assert run(["identify", "two_link", str(logs[0]), "--drop-first", "2000", "-o", str(path), "-q"]) == 0
    return path


def test_residual_within_a_band(capsys, logs, estimate):
    found = {}
    for band in (5, 20):
        code, answer = call_json(capsys, "validate", "two_link", estimate, logs[1], "--band", band)
        assert code == 0
        result = answer["result"]["band"]
        assert result["frequency"] == band
        assert [entry["joint"] for entry in result["residual"]] == ["shoulder", "elbow"]
        assert all(0.0 < entry["range_percent"] < entry["relative_percent"] for entry in result["residual"])
        mean = sum(entry["relative_percent"] for entry in result["residual"]) / 2.0
        assert result["mean_relative_percent"] == pytest.approx(mean)
        found[band] = mean
    # The noise is white: a narrower band holds less of it.
    # The file of this robot states filter and decimation: without a band all rows count.
    plain = call_json(capsys, "validate", "two_link", estimate, logs[1])[1]["result"]
    assert (plain["scoring"], plain["all_rows"]) == (None, [])
    assert found[5] < found[20] < plain["mean_relative_percent"]
    # What the gate tests is what is said.
    assert answer["result"]["mean_relative_percent"] == found[20]


def test_the_gate_is_of_the_band(capsys, logs, estimate):
    call = ("validate", "two_link", estimate, logs[1], "--band", 5)
    _, answer = call_json(capsys, *call)
    reached = answer["result"]["band"]["mean_relative_percent"]
    assert call_json(capsys, *call, "--gate", 1.01 * reached)[0] == 0
    code, answer = call_json(capsys, *call, "--gate", 0.99 * reached)
    assert code == 1
    assert answer["result"]["accepted"] is False
    assert run(["validate", "two_link", str(estimate), str(logs[1]), "--band", "5", "-q"]) == 0
    out = capsys.readouterr().out
    assert f"within 5 Hz: mean relative residual {reached:.4f} %" in out
    assert "of range/%" in out


class Reader(HTMLParser):
    def __init__(self):
        super().__init__()
        self.texts, self.figures = [], 0

    def handle_starttag(self, tag, attrs):
        self.figures += tag == "svg" and "role" in dict(attrs)

    def handle_data(self, data):
        self.texts.append(data)


def read_page(path):
    reader = Reader()
    reader.feed(path.read_text(encoding="utf-8"))
    return " ".join(reader.texts), reader.figures


def test_a_report_with_a_diagnosis(capsys, logs, estimate, tmp_path):
    page = tmp_path / "page.html"
    call = ("report", estimate, "--diagnose", "--validation", logs[1], "-o", page)
    code, answer = call_json(capsys, *call)
    assert code == 0
    found = answer["result"]["diagnosis"]
    assert found["rank"] == len(found["singular_values"]) == 12
    essential = found["essential"]
    assert len(essential["kept"]) + len(essential["dropped"]) == 12
    assert {entry["name"] for entry in found["bootstrap"]["parameters"]} >= set(essential["kept"])
    assert all(entry["low"] < entry["high"] for entry in found["bootstrap"]["parameters"])
    assert found["drift"] == {"compared": 0, "changed": []}
    text, figures = read_page(page)
    for heading in (
        "Identifiability",
        "Significant parameters",
        "Standard deviations by block bootstrap",
        "Drift between logs",
        "Structure of the residual",
    ):
        assert heading in text
    # The spectrum, three profiles a joint, three figures a joint of the held-out log, and perhaps an ellipse.
    assert figures in (15, 16)
    first = page.read_bytes()
    assert run([*map(str, call), "--force", "-q"]) == 0
    assert page.read_bytes() == first


def test_a_diagnosis_in_words(capsys, logs, tmp_path):
    both = tmp_path / "both.json"
    fit = ["identify", "two_link", *map(str, logs), "--drop-first", "2000", "--rows", "momentum"]
    assert run([*fit, "--estimator", "wls", "-o", str(both), "-q"]) == 0
    capsys.readouterr()
    assert run(["report", str(both), "--diagnose", "-o", str(tmp_path / "page.html"), "-q"]) == 0
    out = capsys.readouterr().out
    assert "(12 of 12)" in out
    assert "(> 2 sigma)" in out
    assert "of 12 parameters differ" in out


def test_energy_rows_have_no_diagnosis(capsys, logs, tmp_path):
    path = tmp_path / "energy.json"
    fit = ["identify", "two_link", str(logs[0]), "--drop-first", "2000", "--rows", "energy"]
    assert run([*fit, "-o", str(path), "-q"]) == 0
    capsys.readouterr()
    code, answer = call_json(capsys, "report", path, "--diagnose", "-o", tmp_path / "page.html")
    assert code == 2
    assert answer["errors"][0]["code"] == "usage.mixed-rows"
    assert not (tmp_path / "page.html").exists()


@pytest.fixture(scope="module")
def friction(logs):
    """Return a law of friction found for the robot."""
    path = logs[0].parent / "friction.json"
    call = ["identify", "two_link", str(logs[0]), "--rows", "friction", "--model", "coulomb-viscous"]
    assert run([*call, "-o", str(path), "-q"]) == 0
    return path


def test_laws_of_friction_have_neither(capsys, logs, friction, tmp_path):
    code, answer = call_json(capsys, "validate", "two_link", friction, logs[1], "--band", 10)
    assert (code, answer["errors"][0]["code"]) == (2, "usage.no-band")
    code, answer = call_json(capsys, "report", friction, "--diagnose", "-o", tmp_path / "page.html")
    assert (code, answer["errors"][0]["code"]) == (2, "usage.no-diagnosis")
