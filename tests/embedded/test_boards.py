"""Generated C on a Cortex-M4F (float) and a Cortex-M7 (double), imitated by QEMU, against this machine.

The reference is the double library on this machine, at the same numbers: all inputs are floats.
"""

import numpy as np
import pytest

from tests.embedded.programs import draw_inputs, join_inputs, split_outputs, write_runner
from tests.embedded.sources import with_folders
from tests.embedded.tools import CORTEX_M4F, CORTEX_M7, build_image, find_tool, run_command, run_image

pytestmark = pytest.mark.embedded

STATES = 100
CASES = {"float": (CORTEX_M4F, "float32"), "double": (CORTEX_M7, "float64")}
# Largest error, divided by the largest reference of the output at all states. Forward dynamics and its
# derivatives divide by the mass matrix, and their errors grow with the condition number.
ALLOWED = {"float": 2e-6, "double": 4e-15}
ALLOWED_FORWARD = {"float": 2e-4, "double": 1e-12}
each_source = with_folders(("panda", "two_link_elastic", "two_arms"), list(CASES), library=("panda",))


def draw_all(card):
    return {spec.name: draw_inputs(card, spec, STATES) for spec in card.functions}


@pytest.fixture(scope="module")
def find_reference(sources, tmp_path_factory):
    """Return what the double library gives on this machine, robot for robot."""
    known = {}

    def find(robot):
        if robot not in known:
            folder = sources(robot, "double", "library")
            card = folder.functions.card
            place = tmp_path_factory.mktemp("reference")
            (place / "main.c").write_text(write_runner(folder.prefix, card, "double", STATES))
            (place / "inputs.bin").write_bytes(join_inputs(draw_all(card), card.functions, "float64"))
            flags = ("-std=c99", "-O0", f"-I{folder.path}")
            run_command(
                find_tool("gcc"), *flags, *folder.library, "main.c", "-lm", "-o", "main", folder=place
            )
            run_command(place / "main", folder=place)
            data = (place / "outputs.bin").read_bytes()
            known[robot] = split_outputs(data, card.functions, STATES, "float64")
        return known[robot]

    return find


def run_on_board(folder, place, library=None):
    board, kind = CASES[folder.precision]
    card = folder.functions.card
    (place / "main.c").write_text(write_runner(folder.prefix, card, folder.precision, STATES))
    (place / "inputs.bin").write_bytes(join_inputs(draw_all(card), card.functions, kind))
    image = build_image(
        board, [*(library or folder.library), place / "main.c"], folder.path, place / "image.elf"
    )
    run_image(board, image, place)
    return split_outputs((place / "outputs.bin").read_bytes(), card.functions, STATES, kind)


@each_source
def test_a_board_computes_what_this_machine_does(folder, find_reference, tmp_path, figure):
    got, wanted = run_on_board(folder, tmp_path), find_reference(folder.robot)
    errors, worst = {}, {}
    for name, outputs in wanted.items():
        for port, reference in outputs.items():
            assert np.isfinite(got[name][port]).all(), (name, port)
            error = np.abs(got[name][port] - reference).max(initial=0.0)
            errors[name, port] = error
            scale = np.abs(reference).max(initial=0.0)
            worst[name] = max(worst.get(name, 0.0), error / scale if scale else error)
    board = CASES[folder.precision][0].name
    error = errors["inverse_dynamics", "tau"]
    largest = np.abs(wanted["inverse_dynamics"]["tau"]).max()
    figure(
        f"{board}, {folder.label}, {STATES} states: error of inverse dynamics {error:.2e} N m,"
        f" largest torque {largest:.1f} N m"
    )
    listed = ", ".join(f"{name} {ratio:.1e}" for name, ratio in worst.items())
    figure(f"{board}, {folder.label}, error by the largest value: {listed}")
    if folder.robot == "panda":
        assert error <= (2e-5 if folder.precision == "float" else 1e-12 * largest)
    allowed = dict.fromkeys(worst, ALLOWED[folder.precision])
    allowed |= {name: ALLOWED_FORWARD[folder.precision] for name in worst if "forward_dynamics" in name}
    assert {name: ratio for name, ratio in worst.items() if ratio > allowed[name]} == {}


@each_source
def test_the_self_test_passes_on_a_board(folder, tmp_path, figure):
    """It calls the batch functions and NULL besides."""
    board, _ = CASES[folder.precision]
    image = build_image(
        board, [*folder.library, folder.path / "selftest.c"], folder.path, tmp_path / "image.elf"
    )
    printed = run_image(board, image, tmp_path)
    assert "FAILED" not in printed
    last = printed.splitlines()[-1]
    assert last.startswith("0 of ")
    figure(f"self-test on {board.name} in QEMU, {folder.label}: {last}")
