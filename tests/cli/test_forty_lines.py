"""What a command prints by default fits a terminal, says where the rest is, and -v prints all of it."""

import math
import re
import shutil
import time
from itertools import pairwise

import pytest

from symid.cli.call import LINES, Console
from symid.cli.main import run
from symid.report.blocks import Table, shorten_text
from symid.robot.simulator_writers import write_urdf
from symid.robot.toml_reader import read_robot
from tests.estimates import fill_robot

pytestmark = pytest.mark.usefixtures("shared_work")


@pytest.fixture(scope="module")
def folder(tmp_path_factory, robots_folder):
    """Return a folder with an arm of six joints as a URDF with rounded angles, and two logs of it."""
    root = tmp_path_factory.mktemp("forty")
    text = write_urdf(fill_robot(read_robot(robots_folder / "kr30.toml")))
    (root / "arm.urdf").write_text(text.replace("1.5707963267948966", "1.5708"), encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(root)
        for seed in ("1", "2"):
            command = ["simulate", "arm.urdf", "-o", f"{seed}.npz", "--duration", "8", "--noise", "0.2"]
            assert run([*command, "--seed", seed, "-q"]) == 0
        assert run(["identify", "arm.urdf", "1.npz", "-o", "fit.json", "--estimator", "wls", "-q"]) == 0
        shutil.copy("fit.json", "other.json")
        assert run(["generate", "two_link", "-o", "code", "-q"]) == 0
    return root


def call(capsys, command):
    capsys.readouterr()
    assert run(command.split()) == 0
    return capsys.readouterr()


COMMANDS = (
    *("base panda", "base ur10", "base two_link", "base quadruped", "derive two_link", "derive scara"),
    *("check arm.urdf", "base arm.urdf", "check arm.urdf 1.npz", "validate arm.urdf fit.json 2.npz"),
    "identify arm.urdf 1.npz --estimator wls --cutoff 40 --force -o out.json",
    "identify arm.urdf 1.npz --rows friction --model coulomb-viscous --force -o law.json",
    *("new arm.toml --from-urdf arm.urdf --force", "generate two_link -o code", "doctor"),
    *("simulate two_link --duration 2 --force -o two.npz", "export arm.urdf fit.json --force -o found.urdf"),
    *("compare arm.urdf fit.json other.json", "report fit.json --force -o page.html"),
    "plot arm.urdf 1.npz --force -o plot.html",
)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_prints_forty_lines(folder, capsys, monkeypatch, command):
    monkeypatch.chdir(folder)
    brief = call(capsys, command)
    assert len((brief.out + brief.err).splitlines()) <= LINES
    assert not re.search(r"\d\.\d{13}", brief.out + brief.err)
    whole = call(capsys, f"{command} -v")
    if brief.out != whole.out:
        assert "shortened: -v prints all" in brief.out
        assert len(whole.out.splitlines()) >= len(brief.out.splitlines()) - 2
    if "-o" in command and "shortened" in brief.out:
        assert f"all values are in {command.split()[-1]}" in brief.out


def test_notes_of_a_robot_file_are_printed_by_check(folder, capsys, monkeypatch):
    """The notices `robot.notes` and `robot.warnings` stand for them elsewhere."""
    monkeypatch.chdir(folder)
    notes = [line for line in call(capsys, "check arm.urdf").err.splitlines() if "arm.urdf" in line]
    assert len(notes) >= 2
    for command in ("base arm.urdf", "validate arm.urdf fit.json 2.npz"):
        said = call(capsys, command).err
        for kind in ("note", "warning"):
            count = sum(line.startswith(f"{kind}:") for line in notes)
            counted = f"{kind}: arm.urdf: {count} {kind}{'s' * (count > 1)} on the robot file: symid check "
            assert (counted in said) == bool(count)
        assert not any(note in said for note in notes)
        assert all(note in call(capsys, f"{command} -v").err for note in notes)


ROWS = [(f"p{k}", float(k)) for k in range(50)]
TABLE = Table(("name", "value"), ROWS)


@pytest.mark.parametrize("most", [12, 20, 30])
@pytest.mark.parametrize(
    "blocks", [(TABLE,), ("head", TABLE, "tail"), (TABLE, "one\n\ntwo", TABLE), ("a",) * 40]
)
def test_the_longest_parts_are_cut(blocks, most):
    lines = shorten_text(blocks, most).splitlines()
    assert len(lines) <= most
    shown = sum(not line.startswith("... ") for line in lines)
    hidden = sum(
        int(found) for found in re.findall(r"^\.\.\. (\d+) more lines$", "\n".join(lines), re.MULTILINE)
    )
    assert hidden > 0
    total = sum(len(str(block).splitlines()) for block in blocks) + len(blocks) - 1
    assert total - 2 <= shown + hidden <= total


def test_the_worst_rows_stay_and_no_table_without_rows():
    rows = [("a", "3.1"), ("b", "2e+02"), ("c", 7.0), ("d", None), ("e", math.inf), ("f", "1")]
    table = Table(("name", "std/%"), rows, worst=1)
    lines = shorten_text((table,), 6).splitlines()
    assert [line.split()[0] for line in lines[2:5]] == ["b", "c", "e"]
    assert lines[-1] == "... 3 more lines of less std/%"
    # Beside long texts, each table with a header has a row, or one line.
    text = "\n".join(f"line {k}" for k in range(9))
    lines = shorten_text((text, table, text, TABLE, text), 22).splitlines()
    assert len(lines) <= 22
    for line, after in pairwise(lines):
        assert not (line.startswith("---") and after.startswith("..."))
    assert sum(line.startswith("---") for line in lines) >= 1


def test_what_fits_is_whole():
    assert shorten_text(("head", TABLE), 54) == f"head\n\n{TABLE}"


def test_a_long_silence_is_told_in_a_terminal(capsys, monkeypatch):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    console = Console(start=time.monotonic() - 5.0)
    with console.tick():
        console.progress("deriving the dynamics")
        time.sleep(1.3)
    said = capsys.readouterr().err
    assert re.search(r"\r +\rderiving the dynamics: \d s", said)
    assert re.search(r"\r +\r$", said)
    quiet = Console(start=time.monotonic() - 5.0, quiet=True)
    with quiet.tick():
        time.sleep(1.2)
    assert capsys.readouterr().err == ""
