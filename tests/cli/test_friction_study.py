"""`symid study friction-tables`."""

import json
import re
import xml.etree.ElementTree as ET

import pytest

from symid.study.friction_protocols import ESTIMATORS
from tests.calls import call, hear, refuse, say


@pytest.fixture(scope="module")
def answer(tmp_path_factory):
    """Return exit code, the two streams, and the page of a run with few draws."""
    page = tmp_path_factory.mktemp("study") / "tables.html"
    order = ("study", "friction-tables", "--seeds", "2", "--jobs", "1", "-o", page, "--json", "-q")
    return *call(*order), page


def test_the_answer_is_one_object_with_all_tables(answer):
    code, out, err, page = answer
    assert code == 0, err
    result = json.loads(out)["result"]
    assert result["seeds"] == [0, 1]
    assert [row["estimator"] for row in result["agreement"][0]["rows"]] == list(ESTIMATORS)
    assert [entry["joint"] for entry in result["recovery"]] == ["1", "2", "3"]
    assert [entry["viscous"]["paper"] for entry in result["gains"]] == [28.6, 17.7, 33.6]
    assert [entry["stribeck"]["paper"] for entry in result["gains"]] == [16.3, 11.8, 17.3]
    # What of Table 4 was set stands beside its numbers, and both searches of Table 2 side by side.
    for entry in result["gains"]:
        assert (entry["viscous"]["role"], entry["stribeck"]["role"]) == ("calibrated", "prediction")
        assert "0.117 rad/s" in entry["calibration"]
    for race in result["races"]:
        assert [cost["estimator"] for cost in race["costs"]] == ["genetic", "annealing"]
        assert race["draws"] == 2
    assert len(result["races"]) == 4
    assert result["file"] == str(page)
    assert err == ""


def test_the_default_has_the_least_objective_of_all(answer):
    contests = json.loads(answer[1])["result"]["contests"]
    for contest in contests:
        runs = {run["estimator"]: run for run in contest["runs"]}
        assert runs["varpro"]["excess"] <= 1e-6
        assert runs["varpro"]["solves"] <= 150
    # Two directions are not for root finding, and null is what JSON has for no number.
    assert {run["seconds"] for contest in contests for run in contest["runs"]} == {None}
    refused = next(run for run in contests[1]["runs"] if run["estimator"] == "root-finding")
    assert refused["objective"] is None
    assert "varpro" in refused["reason"]


def test_the_page_has_a_counterpart_of_every_figure(answer):
    text = answer[3].read_text(encoding="utf-8")
    assert "nan" not in re.sub(r"[a-z]nan|nan[a-z]", "", text.lower())
    for number in (1, 2, 3, 4, 6, 7, 8, 9, 10, 11):
        assert f"Figure {number}" in text
    figures = re.findall(r"<svg.*?</svg>", text, flags=re.DOTALL)
    # All of them, and that of the estimators' curves beside the verdict.
    assert len(figures) == 14
    for figure in figures:
        root = ET.fromstring(figure)  # noqa: S314  our own text
        assert root.find("{http://www.w3.org/2000/svg}title").text
    # What the figures without a public original are, what was set and what follows.
    assert "only the caption is public" in text
    assert "neither its maker nor its dimensions" in text
    assert text.count("Calibrated: the noise of each joint") == 3
    assert '<td class="text">calibrated</td>' in text
    # 0.47, -3.34, -4.74 N m at 3.84, 13.57, 9.53 N m, by hand.
    assert "1.5, 5.7, 19.8 %" in text
    assert "script" not in text
    assert "ms*" not in text


@pytest.mark.parametrize(
    "arguments",
    [
        ("friction-tables", "--robot", "two_link_elastic"),
        ("elastic", "-o", "page.html"),
        ("tracking", "--times"),
    ],
)
def test_options_that_a_study_does_not_read_are_refused(arguments):
    assert f"Try 'symid study {arguments[0]} --help'." in hear(2, "usage.call", "study", *arguments)


def test_every_study_has_help_of_its_own():
    names = re.findall(r"^  ([a-z-]+)  ", say("study", "--help").partition("Commands:")[2], re.MULTILINE)
    assert names == ["cutoff", "elastic", "foreign", "friction-tables", "precision", "six-joints", "tracking"]
    takes = {}
    for name in names:
        text = say("study", name, "--help")
        assert "--json" in text
        takes[name] = {option for option in ("--times", "--output", "--seeds") if option in text}
    assert takes["friction-tables"] == {"--times", "--output", "--seeds"}
    assert takes["tracking"] == {"--seeds"}
    assert takes["cutoff"] == set()


@pytest.mark.parametrize("flags", [("--json",), ("-q", "--json"), ("-vq", "--json")])
def test_common_flags_stand_before_a_study_or_behind_it(flags):
    arguments = ("friction-tables", "--seeds", "1")
    behind = call("study", *arguments, *flags)
    assert call("study", *flags, *arguments) == behind
    # One draw is refused.
    assert (behind[0], json.loads(behind[1])["errors"][0]["code"]) == (2, "usage.friction-draws")


def test_a_study_must_be_named():
    assert "one of elastic, tracking" in hear(2, "usage.call", "study")
    code, _, err = call("study")
    assert (code, "friction-tables" in err) == (2, True)


def test_a_page_that_cannot_be_written_is_refused_before_the_work(tmp_path):
    page = tmp_path / "page.html"
    page.write_text("mine", encoding="utf-8")
    for target, code in ((page, "output.exists"), (tmp_path / "none" / "page.html", "output.no-folder")):
        assert refuse("study", "friction-tables", "-o", target) == (3, [code])
    assert page.read_text(encoding="utf-8") == "mine"
