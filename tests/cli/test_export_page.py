"""The page on export and payloads: its commands run, its program compiles, its payload comes out."""

import re
import shlex
import subprocess
from pathlib import Path

import numpy as np
import pytest

import symid
from symid.cli.main import run
from symid.robot.toml_reader import read_robot
from symid.robot.toml_writer import write_robot
from tests.calls import do
from tests.estimates import add_payload


@pytest.fixture(scope="module")
def page(project):
    return (project / "docs" / "export.md").read_text(encoding="utf-8")


def list_blocks(page, language):
    return re.findall(rf"^```{language}\n(.*?)^```$", page, re.DOTALL | re.MULTILINE)


def run_lines(block):
    for line in block.splitlines():
        assert run([*shlex.split(line)[1:], "-q"]) == 0, line


@pytest.fixture(scope="module")
def folder(page, tmp_path_factory, robots_folder):
    root = tmp_path_factory.mktemp("export-page")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(root)
        run_lines(list_blocks(page, "sh")[0])
        robot = read_robot(robots_folder / "two_link.toml")
        body = (0.8, (0.1, 0.02, 0.0), (0.002, 0.0, 0.0, 0.002, 0.0, 0.003))
        loaded = write_robot(add_payload(robot, *body))
        (root / "loaded.toml").write_text(loaded, encoding="utf-8")
        run_lines("symid simulate loaded.toml -o loaded.npz")
    return root


def test_every_format_of_the_table_is_written(page, folder):
    table = re.findall(r"^\| `\.(\w+)`(?:, `\.\w+`)? \|", page, re.MULTILINE)
    written = {path.suffix[1:] for path in folder.iterdir()}
    assert len(table) == 6
    assert set(table) <= written


def test_the_program_runs_with_the_library(page, folder, c_compiler):
    program, _ = list_blocks(page, "c")
    code = folder / "code"
    do("generate", "two_link", "-o", code)
    (folder / "main.c").write_text(program, encoding="utf-8")
    sources = sorted(str(path) for path in code.glob("symid_two_link_*.c"))
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", f"-I{code}", f"-I{folder}"]
    command = [c_compiler, *flags, "-o", str(folder / "main"), str(folder / "main.c"), *sources, "-lm"]
    subprocess.run(command, check=True, timeout=120)
    done = subprocess.run([str(folder / "main")], check=True, capture_output=True, text=True, timeout=20)
    assert re.fullmatch(r"-?[\d.]+ -?[\d.]+, Coulomb friction of the elbow 0\.\d+ N m\n", done.stdout)


def test_two_tools_in_one_program(page, folder, c_compiler, monkeypatch):
    monkeypatch.chdir(folder)
    run_lines(
        "symid identify two_link loaded.npz -o gripper.json\nsymid identify two_link log.npz -o camera.json"
    )
    run_lines(list_blocks(page, "sh")[-4])
    (folder / "tools.c").write_text(list_blocks(page, "c")[1], encoding="utf-8")
    sources = sorted(map(str, Path("two_link_c").glob("symid_two_link_*.c")))
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-Itwo_link_c", "-I."]
    subprocess.run([c_compiler, *flags, "-o", "tools", "tools.c", *sources, "-lm"], check=True, timeout=120)
    done = subprocess.run(["./tools"], check=True, capture_output=True, text=True, timeout=20)
    gripper, camera = ([float(number) for number in line.split()] for line in done.stdout.splitlines())
    state = ([0.5, -1.0], [0.2, 0.1], [1.0, -2.0])
    for torques, name in ((gripper, "loaded.toml"), (camera, "two_link")):
        robot = symid.load(name)
        library, values = robot.compile(), list(robot.base.values.values())
        expected = library.inverse_dynamics(*state, values[:6]) + library.friction(state[1], values[6:])
        assert torques == pytest.approx(expected, rel=0.01, abs=0.01)
    assert abs(gripper[0] - camera[0]) > 0.5


def test_a_tool_is_appended_to_identified_values(page, folder, monkeypatch):
    """The torque is that of the true arm, plus the tool's of the drawing in hand-written trigonometry."""
    monkeypatch.chdir(folder)
    before, after = list_blocks(page, "sh")[-3:-1]
    run_lines(before)
    (tool,) = (block for block in list_blocks(page, "toml") if 'kind = "fixed"' in block)
    with Path("welder.toml").open("a", encoding="utf-8") as file:
        file.write(tool)
    run_lines(after)
    assert run(["export", "welder.toml", "estimate.json", "-o", "again.h", "-q"]) == 3
    plain = symid.load("two_link")
    library, elbow = plain.compile(), plain.description.joints[1]
    length = elbow.placement.translation[0].to_float()
    values = Path("welder_values.h").read_text(encoding="utf-8").partition("welder_beta[6] = {")[2]
    beta = [float(number) for number in re.findall(r"^    (\S+),", values.partition("};")[0], re.MULTILINE)]
    q = np.array([0.4, -0.9])
    x, y = 0.35 + 0.03 * np.cos(np.pi / 6), 0.03 * np.sin(np.pi / 6)
    more = 0.8 * 9.81 * (x * np.cos(q.sum()) - y * np.sin(q.sum()))
    more = [more + 0.8 * 9.81 * length * np.cos(q[0]), more]
    assert library.gravity(q, beta) - library.gravity(q, library.beta) == pytest.approx(more, abs=0.02)


def test_the_payload_comes_out(page, folder, capsys, monkeypatch):
    monkeypatch.chdir(folder)
    (line,) = list_blocks(page, "sh")[-1].splitlines()
    assert run(shlex.split(line)[1:]) == 0
    mass = re.search(r"^mass +([\d.]+) +([\d.]+) +kg$", capsys.readouterr().out, re.MULTILINE)
    assert abs(float(mass[1]) - 0.8) < 4 * float(mass[2]) < 0.1
