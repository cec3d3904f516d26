"""Blocks of the pages that are no commands: C compiles, tables are read, Python runs; none is lost."""

import inspect
import re
import shutil
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

import symid
from benchmarks.friction_rig import Rig, RigOptions, SpringDrive, simulate_friction_rig
from symid.cli.main import run
from symid.codegen.c_library import generate_friction_state
from symid.joint_models import get_law
from symid.robot.toml_reader import parse_robot
from tests.docs.test_page_commands import FROZEN, SCENES
from tests.pages import DOCS, ELSEWHERE, find_elsewhere, list_blocks, list_pages
from tests.recovery.test_friction_dynamic import LUGRE, build_samples
from tests.transcripts import run_step

HERE = {
    "elastic.md": ("[joint.elasticity]",),
    "embedded.md": ("void control",),
    "export.md": ('kind = "fixed"',),
    "fleet.md": ("# plant.toml", "symid fleet", "progress=print", "SLURMCluster"),
    "friction_dynamic.md": ("fit_friction(samples", "symid_friction_lugre_init"),
    "logs.md": ("[log]", "[[run]]"),
    "robot_file.md": ("[log]", 'model = "bouc-wen"', "symid_arm_shoulder_inverse"),
}
"""What stands in blocks that are tried here, or beside the commands of their page."""


def find_block(page, part):
    """Return the body of the block of a page in which a text stands."""
    (block,) = (entry for entry in list_blocks(page) if part in entry.body)
    return block.body


def compile_lines(compiler, folder, head, lines, parameters):
    """Compile lines of C of a page as the body of a function."""
    text = f"{head}\nvoid page({parameters});\nvoid page({parameters})\n{{\n{lines}}}\n"
    (folder / "page.c").write_text(text, "utf-8")
    places = [f"-I{path}" for path in (folder, *folder.rglob("*")) if path.is_dir()]
    command = [compiler, "-std=c99", "-Wall", "-Wextra", "-Werror", "-c", "page.c", "-o", "page.o", *places]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_c_for_a_controller(tmp_path, c_compiler):
    symid.load("two_link").write("c", tmp_path / "code", functions=["inverse_dynamics"], precision="float")
    text = find_block("embedded.md", "void control").replace("panda", "two_link").replace("PANDA", "TWO_LINK")
    compile_lines(c_compiler, tmp_path, text, "", "void")


def test_c_for_springs_with_branches(tmp_path, c_compiler):
    arm = find_block("robot_file.md", 'name = "elastic_arm"').replace("elastic_arm", "arm")
    bent = find_block("robot_file.md", 'model = "bouc-wen"')
    before, _, after = arm.partition("[joint.elasticity]")
    text = f"{before}{bent}\n[[joint]]{after.partition('[[joint]]')[2]}"
    (tmp_path / "arm.toml").write_text(text, "utf-8")
    symid.load(tmp_path / "arm.toml").write("c", tmp_path / "code", functions=["inverse_dynamics"])
    compile_lines(
        c_compiler,
        tmp_path,
        '#include "symid_arm.h"\n#include "symid_arm_shoulder.h"',
        find_block("robot_file.md", "symid_arm_shoulder_inverse"),
        "const double *q, const double *dq, const double *ddq, const double *beta, double *tau, double *phi, "
        "double *theta, symid_arm_shoulder_state shoulder",
    )


def test_c_and_a_fit_for_friction_with_a_memory(tmp_path, c_compiler, capsys):
    law = get_law("lugre")
    for name, text in generate_friction_state(law, precision="double"):
        (tmp_path / name).write_text(text, "utf-8")
    lines = find_block("friction_dynamic.md", "symid_friction_lugre_init")
    compile_lines(c_compiler, tmp_path, '#include "symid_friction_lugre.h"', lines, "double velocity")
    motion = SpringDrive(stiffness=2000.0, speed=0.02)
    run = simulate_friction_rig(Rig(values=LUGRE, mass=1.0), motion, RigOptions(duration=2.0))
    names = {"law": law, "samples": build_samples(run, 1)}
    exec(find_block("friction_dynamic.md", "fit_friction(samples"), names)  # noqa: S102  the page's own example
    assert capsys.readouterr().out.startswith("[('")


HEAD = 'name = "arm"\nconvention = "modified"\ngravity = [0, 0, -9.81]\n'
JOINT = '[[joint]]\nkind = "{kind}"\n{more}'
DRIVE = "[joint.drive]\ngear = 100\ntorque_constant = 0.07\n"


def test_tables_of_robot_files_are_read():
    spring = find_block("elastic.md", "[joint.elasticity]")
    robot = parse_robot(HEAD + JOINT.format(kind="revolute", more=spring))
    assert [stop.threshold for stop in robot.joints[0].elasticity.stops] == [0.002, 0.005]
    logs = [
        block.body
        for page in ("robot_file.md", "logs.md")
        for block in list_blocks(page)
        if block.body.startswith("[log]")
    ]
    assert len(logs) == 4
    for text in logs:
        kind = "prismatic" if '"m"' in text else "revolute"
        joints = JOINT.format(kind=kind, more=DRIVE) * (2 if "transmission" in text else 1)
        assert parse_robot(HEAD + joints + text).log


@pytest.mark.usefixtures("c_compiler")
def test_a_tool_known_from_drawings(tmp_path, robots_folder):
    """The header has the functions of the plain robot, and values that differ by the tool's weight."""
    plain = symid.load(robots_folder / "two_link.toml")
    file, header = tmp_path / "gripper.toml", tmp_path / "gripper_values.h"
    block = find_block("export.md", 'kind = "fixed"')
    file.write_text(f"{plain.path.read_text()}\n{block}")
    assert run(["export", str(file), "--name", "gripper", "-o", str(header), "-q"]) == 0
    own, tool = plain.compile(), symid.load(file).compile()
    assert f'GRIPPER_VALUES_SIGNATURE "{own.card.signature}"' in header.read_text()
    q = np.array([0.3, -0.8])
    more = tool.gravity(q, tool.beta) - own.gravity(q, own.beta)
    # Its centre of mass, 0.03 and 0.01 m from a frame that is turned by 30 degrees about the elbow's axis.
    reach = 0.35 + 0.03 * np.cos(np.pi / 6)
    side = 0.03 * np.sin(np.pi / 6)
    assert more[1] == pytest.approx(0.8 * 9.81 * (reach * np.cos(q.sum()) - side * np.sin(q.sum())), rel=1e-9)


def test_a_link_of_a_standard_row(tmp_path):
    """Its frame is at its end: weights, by plain levers, are those of the arm and of the tool beyond it."""
    text = find_block("robot_file.md", 'name = "boom"')
    other = text.replace('"standard"', '"modified"').replace("a = 0.4", "a = 0.0")
    other = other.replace("[-0.2, 0, 0]", "[0.2, 0, 0]").replace("[0.05, 0, 0]", "[0.45, 0, 0]")
    for body in (text, other):
        (tmp_path / "boom.toml").write_text(body, "utf-8")
        library = symid.load(tmp_path / "boom.toml").compile()
        weights = 9.81 * (2.0 * 0.2 + 0.5 * (0.4 + 0.05 + 0.1))
        assert library.gravity([0.7], library.beta) == pytest.approx(weights * np.cos(0.7), rel=1e-12)


def test_robots_that_state_link_values_are_named():
    page = (DOCS / "robots.md").read_text(encoding="utf-8")
    named = page.partition("All link values")[2].partition("; the other files")[0]
    shipped = {name: symid.load(name).description.joints for name in symid.list_robots()}
    stating = [name for name, joints in shipped.items() if all(joint.inertial for joint in joints)]
    assert re.findall("`(.*?)`", named) == stating


def test_a_fleet_with_its_table_and_page(tmp_path, robots_folder, monkeypatch):
    pyarrow = pytest.importorskip("pyarrow", reason="wants pyarrow: pip install 'symid[parquet]'")
    parquet = pytest.importorskip("pyarrow.parquet")
    # A night: a log as a Parquet file, with units in its headings.
    log = symid.load("two_link").simulate(duration=6.0, seed=1).log.recording
    columns = {"t [s]": log.time}
    for joint, (q, tau) in enumerate(zip(log.position.T, log.torque.T, strict=True), start=1):
        columns |= {f"q{joint} [rad]": q, f"tau{joint} [N m]": tau}
    night = tmp_path / "nights" / "r1" / "2026-01-01.parquet"
    night.parent.mkdir(parents=True)
    parquet.write_table(pyarrow.table(columns), night)
    shutil.copy(robots_folder / "two_link.toml", tmp_path / "ur10.toml")
    (tmp_path / "plant.toml").write_text(find_block("fleet.md", "# plant.toml"), "utf-8")
    (command,) = (text for block in list_blocks("fleet.md") for text in block.commands)
    code, printed = run_step(command.replace("--workers 8", "--workers 1"), tmp_path, tmp_path / "cache")
    assert code == 0, printed
    assert "1 job: 1 done" in printed
    assert all((tmp_path / f"plant.{kind}").exists() for kind in ("parquet", "html"))
    # All is there already: the script runs nothing again.
    monkeypatch.chdir(tmp_path)
    main = {"__name__": "__main__"}
    exec(find_block("fleet.md", "progress=print"), dict(main))  # noqa: S102  the page's own example
    # There is no SLURM here: the calls have arguments that they take.
    wanted, calls = inspect.signature(symid.fleet.run), []
    cluster = SimpleNamespace(scale=calls.append, scheduler_address="")
    monkeypatch.setitem(sys.modules, "dask_jobqueue", SimpleNamespace(SLURMCluster=lambda **_: cluster))
    monkeypatch.setattr(symid.fleet, "run", lambda *given, **more: calls.append(wanted.bind(*given, **more)))
    exec(find_block("fleet.md", "SLURMCluster"), dict(main))  # noqa: S102  likewise
    assert calls[0] == 100
    assert calls[1].arguments["executor"] == "dask"


def runs_somewhere(block, text):
    """Return whether a command or the text of a block is run by a test."""
    if text in FROZEN or find_elsewhere(block.page, text) or (block.commands and block.page in SCENES):
        return True
    return any(part in text for part in HERE.get(block.page, ()))


def test_no_command_and_no_program_of_the_documentation_is_forgotten():
    """A new command runs where its page has a scene; else write a test, and a line in `ELSEWHERE`."""
    lost = [
        (block.page, block.line, text)
        for page in list_pages()
        for block in list_blocks(page)
        if block.runs
        for text in block.commands or (block.body,)
        if not runs_somewhere(block, text)
    ]
    assert lost == []


def test_the_table_of_other_tests_names_what_is_there():
    assert all((DOCS.parent / test).is_file() for test in ELSEWHERE.values())
    # Who is said to run a whole page takes its blocks from it.
    for page, test in ((page, test) for (page, pattern), test in ELSEWHERE.items() if not pattern):
        name = page.rpartition("/")[2].removesuffix(".md")
        assert name in (DOCS.parent / test).read_text("utf-8"), (page, test)
    for page, pattern in ELSEWHERE:
        blocks = (block for block in list_blocks(page) if block.runs)
        texts = [text for block in blocks for text in block.commands or (block.body,)]
        assert any(re.search(pattern, text, re.MULTILINE) for text in texts), (page, pattern)
