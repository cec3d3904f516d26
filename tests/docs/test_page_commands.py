"""The commands of the pages run as they stand there, with small files in place of the reader's own.

What another test runs is not run again: `ELSEWHERE` names it, `FROZEN` the same call of the frozen answers.
test_page_blocks.py fails for a block that is neither there nor here.
"""

import os
import re
import shlex
import shutil
import subprocess
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from click import Context, Group

from symid.cli.call import symid
from symid.logs.runs import read_log_runs
from symid.robot.toml_reader import read_robot
from tests.golden.freeze import CALLS, read_answer
from tests.pages import DOCS, find_elsewhere, list_blocks, list_pages
from tests.transcripts import run_step

ARM = """
[controller]
stiffness = [400, 60]
damping = [25, 3]
velocity_filter = 150
torque = "average"
"""
"""Behind the shipped arm of two links: the robot `arm` of the pages."""


@dataclass(frozen=True)
class Scene:
    """What the commands of a page need, beside the stock.

    Attributes:
        files: by the names of the page, those of the stock or, with a slash, of the recordings.
        words: placeholders and long words of the page, and what is typed in their place.
        more: options that make a command short, by the words that it begins with.
        codes: exit codes that the page says, by command; 0 for the others.
    """

    files: dict[str, str] = field(default_factory=dict)
    words: dict[str, str] = field(default_factory=dict)
    more: dict[str, str] = field(default_factory=dict)
    codes: dict[str, int] = field(default_factory=dict)


PLACES = {"ROBOT": "two_link", "ESTIMATE": "estimate.json", "LOG": "held.npz", "OTHER...": "other.json"}
SMALL = {"panda": "two_link", "arm": "arm.toml"}
PULSES = {"DATA_EMPS.mat": "emps/DATA_EMPS.mat", "DATA_EMPS_PULSES.mat": "emps/DATA_EMPS_PULSES.mat"}
PENDULUM = {f"run_{number}.csv": f"double_pendulum/run_{number}.csv" for number in (1, 2, 3, 4)}
SHEET = "symid derive two_link_symbols --check "
SCENES = {
    "c_library.md": Scene(words=SMALL),
    "command_line.md": Scene(files=PULSES, more={"symid simulate two_link_elastic": "--duration 2"}),
    "compare.md": Scene(words=PLACES),
    "course.md": Scene(words={"panda": "scara"}, codes={f"{SHEET}two_links.exercises.txt": 1}),
    "diagnosis.md": Scene(files=PULSES | PENDULUM, words=PLACES),
    "embedded.md": Scene(words=SMALL),
    "export.md": Scene(words=SMALL),
    "friction.md": Scene(
        files=PULSES
        | dict.fromkeys(("moves.npz", "slow.npz", "elbow_up.npz"), "log.npz")
        | dict.fromkeys(("fast.npz", "elbow_down.npz"), "held.npz")
        | {"elbow_out.npz": "third.npz", "training.csv": "log.npz", "arm_cad.toml": "arm.toml"},
        words=SMALL | {"training.csv": "slow.npz"},
    ),
    "identify.md": Scene(words=SMALL),
    "lessons.md": Scene(words={"puma560": "scara"}, codes={f"{SHEET}lesson.exercises.txt": 1}),
    "logs.md": Scene(words=PLACES),
    "quickstart.md": Scene(),
    "robot_file.md": Scene(files=PULSES),
    "urdf.md": Scene(files={"arm.urdf": "two.urdf", "arm.xml": "two.xml"}),
}

FROZEN = {
    "symid identify kr300 run_a.npz run_b.npz run_c.npz --method stiffness --json": "kr300-stiffness",
    "symid identify kr300 run_a.npz run_b.npz -o kr300.json": "kr300-ols",
    "symid validate kr300 kr300.json run_c.npz --band 10": "kr300-validate",
    "symid identify tx40 tx40.npz --estimator wls -o tx40.json": "tx40-wls",
    "symid identify tx40 tx40.npz -o tx40.json": "tx40-ols",
    "symid identify emps DATA_EMPS.mat --settings published": "emps-ols",
    "symid identify emps DATA_EMPS.mat --settings published -o published.json": "emps-ols",
}
"""Commands that the frozen answers have, by the name of the call there."""


def list_commands(page):
    """Return the commands of a page that run here."""
    commands = (command for block in list_blocks(page) for command in block.commands)
    return [text for text in commands if text not in FROZEN and not find_elsewhere(page, text)]


def type_words(command, scene):
    """Return what is typed for a command of the page: with words, options and names of the scene."""
    words = [scene.words.get(word, word) for word in shlex.split(command, comments=True)]
    more = (options for beginning, options in scene.more.items() if command.startswith(beginning))
    return [*words, *(word for options in more for word in shlex.split(options))]


def find_target(words):
    """Return the name of the file that a command writes, "" for none."""
    return words[2] if words[1] == "new" else words[words.index("-o") + 1] if "-o" in words else ""


def call(folder, command, code=0):
    """Run a command in a folder, its target away before, and return what it prints."""
    words = shlex.split(command)
    target = folder / find_target(words)
    if target.is_file():
        target.unlink()
    found, printed = run_step(command, folder, Path(os.environ["XDG_CACHE_HOME"]))
    assert found == code, f"{command}\n{printed}"
    assert target.exists(), target
    return printed


@pytest.fixture(scope="module")
def stock(tmp_path_factory, robots_folder, c_compiler):
    """Return a folder with an arm of two links, logs, estimates and results of it."""
    assert c_compiler
    folder = tmp_path_factory.mktemp("stock") / "work"
    folder.mkdir()
    (folder / "arm.toml").write_text((robots_folder / "two_link.toml").read_text("utf-8") + ARM, "utf-8")
    for seed, name in enumerate(("log.npz", "held.npz", "third.npz")):
        call(folder, f"symid simulate arm.toml --duration 6 --seed {seed} -o {name}")
    call(folder, "symid identify two_link log.npz -o estimate.json")
    call(folder, "symid identify two_link held.npz -o other.json")
    for name in ("two.urdf", "two.xml"):
        call(folder, f"symid export two_link -o {name}")
    return folder


@pytest.fixture
def folder(stock, tmp_path):
    """Return a folder with the files of the stock."""
    return shutil.copytree(stock, tmp_path / "work")


def walk(page, folder, recordings=None, wanted=""):
    """Run the commands of a page that begin as wanted, in their order, and return what each prints."""
    scene = SCENES[page]
    for name, source in scene.files.items():
        if "/" not in source:
            shutil.copy(folder / source, folder / name)
        elif recordings is not None:
            shutil.copy(recordings / source, folder / name)
    return {
        command: call(folder, shlex.join(type_words(command, scene)), code=scene.codes.get(command, 0))
        for command in list_commands(page)
        if re.match(wanted, command)
    }


@pytest.mark.parametrize("page", ["c_library.md", "compare.md", "course.md", "embedded.md", "identify.md"])
def test_the_commands_of_a_page_run(page, folder):
    assert walk(page, folder)


def test_the_quick_start(folder):
    printed = walk("quickstart.md", folder)
    assert "verdict: good" in printed["symid validate two_link estimate.json validation.npz --gate 2"]
    (make,) = re.findall(r"^make -C .*$", (DOCS / "quickstart.md").read_text("utf-8"), re.MULTILINE)
    done = subprocess.run(shlex.split(make), cwd=folder, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr


def test_lessons_urdf_and_mjcf(folder):
    call(folder, "symid derive two_link_symbols --html lesson.html --exercises 8 --seed 3")
    (folder / "lesson.html").unlink()
    assert walk("lessons.md", folder)
    text = (folder / "two.urdf").read_text("utf-8").replace("elbow_link", "wrist_link")
    (folder / "two.urdf").write_text(text, "utf-8")
    assert "no mistakes" in walk("urdf.md", folder)["symid check arm.urdf"]


def test_parts_and_runs_of_logs(folder):
    assert len(walk("logs.md", folder)) == 2
    for name in ("monday.npz", "tuesday.npz", "wednesday.npz"):
        shutil.copy(folder / "log.npz", folder / name)
    runs = [block.body for block in list_blocks("logs.md") if block.body.startswith("[[run]]")]
    found = []
    for text in runs:
        (folder / "runs.toml").write_text(text, "utf-8")
        found.append(len(read_log_runs(folder / "runs.toml", read_robot(folder / "arm.toml"))))
    assert found == [2, 1]


LINK = """<link name="NAME">BODY</link><joint name="to_NAME" type="fixed"><origin xyz="0.2 0 0"/>
<parent link="forearm"/><child link="NAME"/></joint></robot>"""
"""One more link of the arm, fixed to the forearm."""
BODY = """<inertial><origin xyz="0.02 0.01 0.04"/><mass value="0.8"/>
<inertia ixx="0.002" iyy="0.002" izz="0.003" ixy="0" ixz="0" iyz="0"/></inertial>"""


def test_export_and_payload(folder):
    call(folder, "symid identify two_link log.npz --rows friction --model stribeck -o friction.json")
    arm = (DOCS / "own_robot" / "arm.urdf").read_text("utf-8")
    arm = arm.replace("</robot>", LINK.replace("NAME", "flange").replace("BODY", ""))
    heavy = arm.replace("</robot>", LINK.replace("NAME", "load").replace("BODY", BODY))
    for name, text in (("arm", arm), ("carrier", arm), ("heavy", heavy)):
        (folder / f"{name}.urdf").write_text(text, "utf-8")
    for name, robot in (("training.csv", "arm"), ("loaded.npz", "heavy"), ("empty.npz", "carrier")):
        call(folder, f"symid simulate {robot}.urdf --duration 6 --noise 0.05 -o {name}")
    for name in ("loaded", "empty"):
        call(folder, f"symid identify carrier.urdf {name}.npz -o {name}.json")
    # The URDF that another command writes anew has friction then, and is another model.
    (command,) = (text for text in list_commands("export.md") if text.startswith("symid payload"))
    said = call(folder, command.replace("arm.urdf", "carrier.urdf"))
    assert len(walk("export.md", folder, wanted="symid (?!payload)")) == 6
    (numbers,) = re.findall(r"set_target_payload\((.*)\)", said)
    found = [float(number) for number in re.findall(r"-?[\d.]+", numbers)]
    np.testing.assert_allclose(found[:4], [0.8, 0.02, 0.01, 0.04], atol=0.01)


def test_friction_of_the_emps(folder, shared_data):
    printed = walk("command_line.md", folder, shared_data)
    tried = [text for command, text in printed.items() if "emps" in command]
    page = (DOCS / "command_line.md").read_text("utf-8")
    (row,) = re.findall(r"^\| `asymmetric` \| (\S+) % \| (\S+) % \|$", page, re.MULTILINE)
    for said, text in zip(map(float, row), tried, strict=True):
        assert min(abs(said - float(number)) for number in re.findall(r"-?\d+\.\d+", text)) < 0.006


def test_results_on_real_robots(folder, shared_data):
    printed = walk("diagnosis.md", folder, shared_data)
    page = (DOCS / "diagnosis.md").read_text("utf-8")
    for run in (1, 4):
        (said,) = re.findall(rf"\| run {run} \|.* vector (\S+) % \|", page)
        (text,) = (text for command, text in printed.items() if f"run_{run}.csv --band" in command)
        (vector,) = re.findall(r"as one vector: (\S+) %", text)
        assert f"{float(vector):.3g}" == said
    (text,) = (text for command, text in printed.items() if command.startswith("symid identify emps"))
    value, deviation = map(float, re.search(r"M1 +(\S+) +(\S+)", text).groups())
    assert f"mass of {value:.2f} +- {deviation:.2f} kg" in page


def test_friction_and_named_settings(folder, shared_data):
    assert len(walk("friction.md", folder, shared_data)) == 7
    assert len(walk("robot_file.md", folder, shared_data)) == 1


def simplify(words):
    """Return a command as the frozen answers may have it: no folders, no outputs, any fit."""
    words = [Path(word).name for word in words if word not in {"symid", "--json"}]
    if "-o" in words:
        del words[words.index("-o") : words.index("-o") + 2]
    return ["FIT" if word.endswith(".json") else word for word in words]


def test_commands_of_the_frozen_answers_are_those_of_the_pages():
    pages = {command for page in list_pages() for block in list_blocks(page) for command in block.commands}
    for command, name in FROZEN.items():
        assert command in pages
        assert simplify(shlex.split(command)) == simplify(CALLS[name].split()), name


def test_the_pages_have_the_numbers_of_the_frozen_answers():
    text = (DOCS / "diagnosis.md").read_text("utf-8")
    held_out = read_answer("kr300-validate")["result"]["mean_relative_percent"]
    assert f"| KR 300, runs A and B | run C | 10 Hz | {held_out:.1f} % |" in text
    mass = read_answer("emps-ols")["result"]["parameters"][0]
    assert f"{mass['value']:.4f} +- {mass['std']:.4f} kg" in text
    assert f"lag by {read_answer('kr300-stiffness')['result']['delay_ms']:.1f} ms" in text.replace("\n", " ")


def test_verbs_and_options_of_all_commands_exist():
    """Commands that run nowhere are read at least."""
    for page in list_pages():
        for text in (command for block in list_blocks(page) for command in block.commands):
            _, verb, *words = shlex.split(text.partition(" > ")[0], comments=True)
            command = symid.get_command(Context(symid), verb)
            if isinstance(command, Group):
                command = command.get_command(Context(command), words[0])
            known = {name for option in command.params for name in option.opts}
            assert {word.partition("=")[0] for word in words if re.match("-[a-z-]", word)} <= known, text
