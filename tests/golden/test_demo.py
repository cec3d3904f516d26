"""The demo, made once: its numbers, what it leaves behind, and its own verdict."""

import html
import json
import re
from contextlib import chdir

import numpy as np
import pytest

import symid
from symid.api.first_steps import _prepare_folder, judge_demo
from symid.cli.main import run
from symid.environment import mark_scratch
from symid.errors import OutputError
from symid.identification.elastic.validation import TrackingRun
from tests.golden.freeze import Scratch, compare, find_answer, read_answer


@pytest.fixture(scope="module")
def made(tmp_path_factory, c_compiler):
    """Return the folder, the answer of the command line, and the result that it was made from."""
    scratch, results, original = Scratch(tmp_path_factory.mktemp("demo").resolve()), [], symid.demo

    def demo(*arguments, **options):
        results.append(original(*arguments, **options))
        return results[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(symid, "demo", demo)
        answer = find_answer("demo", scratch)
    return scratch.folder, answer, results[0]


def test_its_answer_is_what_it_was_and_good(made):
    differences = compare(read_answer("demo"), made[1], "demo")
    assert not differences, "\n".join(differences[:20])
    result = made[1]["result"]
    assert made[1]["exit_code"] == 0
    for entry in result["estimate"]["parameters"]:
        assert abs(entry["value"] - entry["truth"]) <= max(0.02 * abs(entry["truth"]), 5 * entry["std"])
    assert result["errors"]["automatic"]["hysteresis_percent"] < 1.0
    rigid, together, apart = result["tracking_rms"].values()
    assert max(together) < 1e-2 * min(rigid)
    assert max(together) < min(apart)


def test_figures_of_the_headline_stand_in_the_tables(made):
    page = (made[0] / "demo" / "report.html").read_text(encoding="utf-8")
    headline = re.search(r'<p class="headline">(.*?)</p>', page)[1]
    assert html.unescape(headline).endswith(made[1]["result"]["verdict"]["headline"])
    # What fits to other stretches leave comes after them.
    spring, dynamics, *_ = re.findall(r"([0-9.]+) %", headline)
    tables = re.findall(r"<table>.*?</table>", page, re.DOTALL)
    for text, title in ((spring, "less that of the springs"), (dynamics, "without springs")):
        chosen = "".join(table for table in tables if title in table)
        # The cell behind the name of a joint, of two digits.
        shares = [float(cell) for cell in re.findall(r"</th><td>([0-9.]+) %</td>", chosen)]
        assert len(shares) == 4
        assert max(shares) == float(f"{float(text):.2g}")


def test_its_folder_goes_on_and_is_not_written_over(made, capsys):
    folder = made[0] / "demo"
    assert (folder / "report.html").is_file()
    assert run(["check", str(folder / "identified.toml"), "-q"]) == 0
    capsys.readouterr()
    with chdir(made[0]):
        assert run(["demo", "-o", "demo", "--json"]) == 3
    assert json.loads(capsys.readouterr().out)["errors"][0]["code"] == "output.foreign-folder"


@pytest.mark.parametrize("left", [".report.html.", ".code-", None])
def test_what_a_killed_one_left_is_in_nobodys_way(tmp_path, left):
    """A demo may be made in its folder, without force where nothing else is there."""
    (tmp_path / (f"{mark_scratch(left)}abc" if left else ".code.symid-lock")).touch()
    _prepare_folder(tmp_path, force=False)
    (tmp_path / "tc.npz").touch()
    with pytest.raises(OutputError, match="--force to overwrite the last demo"):
        _prepare_folder(tmp_path, force=False)
    _prepare_folder(tmp_path, force=True)
    (tmp_path / ".bashrc").touch()
    with pytest.raises(OutputError, match=r"give another folder with -o$"):
        _prepare_folder(tmp_path, force=True)


def test_it_does_not_hide_a_bad_end(made, capsys, monkeypatch, tmp_path):
    monkeypatch.setattr(symid, "demo", lambda *_, **__: made[2])
    monkeypatch.setattr("symid.api.first_steps._MOST_PARAMETERS", 1e-9)
    assert run(["demo", "-o", str(tmp_path / "demo"), "--json"]) == 1
    answer = json.loads(capsys.readouterr().out)
    assert "demo.off-truth" in {entry["code"] for entry in answer["errors"]}


@pytest.mark.parametrize(
    ("parameters", "hysteresis", "size", "codes"),
    [
        (1.9, 2.9, 0.001, []),
        (2.1, 1.0, 0.001, ["demo.off-truth"]),
        (np.nan, 1.0, 0.001, ["demo.off-truth"]),
        (1.0, 3.1, 0.001, ["demo.off-spring"]),
        (1.0, np.nan, 0.001, ["demo.off-spring"]),
        (1.0, 1.0, 0.02, ["demo.no-gain"]),
    ],
)
def test_near_the_truth_and_better_than_rigid_is_well(parameters, hysteresis, size, codes):
    runs = (TrackingRun(name=str(k), time=np.zeros(1), error=np.full((1, 2), k)) for k in (0.01, size))
    assert [notice.code for notice in judge_demo((parameters, hysteresis), tuple(runs))] == codes
