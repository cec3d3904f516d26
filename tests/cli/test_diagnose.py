"""`validate --band` and `report --diagnose`: what a fit and its logs tell beyond the parameters."""

from html.parser import HTMLParser

import pytest

from tests.calls import ask, do, fail, say


@pytest.fixture(scope="module")
def logs(log):
    """Return two logs with noisy sensors."""
    other = log.with_name("other.npz")
    do("simulate", "two_link", "-o", other, "--noise", "0.5", "--seed", "4")
    return log, other


def test_residual_within_a_band(logs, estimate):
    means = []
    for band in (5, 20):
        found = do("validate", "two_link", estimate, logs[1], "--band", band)["result"]
        result = found["band"]
        assert result["frequency"] == band
        assert [entry["joint"] for entry in result["residual"]] == ["shoulder", "elbow"]
        assert all(0.0 < entry["range_percent"] < entry["relative_percent"] for entry in result["residual"])
        means.append(sum(entry["relative_percent"] for entry in result["residual"]) / 2.0)
        # What the gate tests is what is said.
        assert result["mean_relative_percent"] == pytest.approx(means[-1])
        assert found["mean_relative_percent"] == result["mean_relative_percent"]
    # The noise is white: a narrower band holds less of it.
    # The file of this robot states filter and decimation: without a band all rows count.
    plain = do("validate", "two_link", estimate, logs[1])["result"]
    assert (plain["scoring"], plain["all_rows"]) == (None, [])
    assert means[0] < means[1] < plain["mean_relative_percent"]


def test_the_gate_is_of_the_band(logs, estimate):
    call = ("validate", "two_link", estimate, logs[1], "--band", 5)
    reached = do(*call)["result"]["band"]["mean_relative_percent"]
    do(*call, "--gate", 1.01 * reached)
    code, answer = ask(*call, "--gate", 0.99 * reached)
    assert code == 1
    assert answer["result"]["accepted"] is False
    out = say("validate", "two_link", estimate, logs[1], "--band", "5")
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


def test_a_report_with_a_diagnosis(logs, estimate, tmp_path):
    page = tmp_path / "page.html"
    call = ("report", estimate, "--diagnose", "--validation", logs[1], "-o", page)
    found = do(*call)["result"]["diagnosis"]
    assert found["rank"] == len(found["singular_values"]) == 12
    essential = found["essential"]
    assert len(essential["kept"]) + len(essential["dropped"]) == 12
    assert {entry["name"] for entry in found["bootstrap"]["parameters"]} >= set(essential["kept"])
    assert all(entry["low"] < entry["high"] for entry in found["bootstrap"]["parameters"])
    assert found["drift"] == {"compared": 0, "changed": []}
    text, figures = read_page(page)
    for heading in (
        "Identifiability",
        "Essential parameters",
        "Standard deviations by block bootstrap",
        "Drift between logs",
        "Structure of the residual",
    ):
        assert heading in text
    # The robot, significance, singular values, perhaps an ellipse; of a joint three profiles, and measured
    # and predicted torque and what is between them.
    assert figures in (13, 14)
    first = page.read_bytes()
    do(*call, "--force")
    assert page.read_bytes() == first


def test_energy_rows_have_no_diagnosis(logs, tmp_path):
    path = tmp_path / "energy.json"
    fit = ["identify", "two_link", str(logs[0]), "--drop-first", "2000", "--rows", "energy"]
    do(*fit, "-o", path)
    assert fail("report", path, "--diagnose", "-o", tmp_path / "page.html") == (2, "usage.mixed-rows")
    assert not (tmp_path / "page.html").exists()


@pytest.fixture(scope="module")
def friction(logs):
    """Return a law of friction found for the robot."""
    path = logs[0].parent / "friction.json"
    call = ["identify", "two_link", str(logs[0]), "--rows", "friction", "--model", "coulomb-viscous"]
    do(*call, "-o", path)
    return path


def test_laws_of_friction_have_neither(logs, friction, tmp_path):
    assert fail("validate", "two_link", friction, logs[1], "--band", 10) == (2, "usage.no-band")
    assert fail("report", friction, "--diagnose", "-o", tmp_path / "page.html") == (2, "usage.no-diagnosis")
