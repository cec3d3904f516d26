"""Logs that are far too poor: refused with every reason, by `identify` and by `check`, with exit code 4."""

import re

import numpy as np
import pytest

from symid.codegen.cache import prepare_library
from symid.dynamics.base_parameters import derive_base_parameters
from symid.excitation.trajectories import FourierOptions, build_random_fourier
from symid.robot.loading import override_robot
from symid.robot.toml_reader import read_robot
from tests.calls import ask, do, refuse
from tests.chains import compute_beta, draw_parameters

pytestmark = pytest.mark.usefixtures("shared_work")

FRICTION = "viscous_coulomb_offset"


@pytest.fixture(scope="module")
def robot(robots_folder):
    return override_robot(read_robot(robots_folder / "panda.toml"), (), FRICTION)


@pytest.fixture(scope="module")
def log(robot, tmp_path_factory):
    """Return a writer of ten seconds in which the joints named by number stand still."""
    library = prepare_library(robot)
    folder = tmp_path_factory.mktemp("poor")

    def write(*still):
        rng = np.random.default_rng(4)
        time = 0.005 * np.arange(2001)
        options = FourierOptions(duration=10.0, base_frequency=0.1, ramp=0.0)
        q, dq, ddq = map(np.array, build_random_fourier(robot, rng, options).evaluate(time))
        q[:, still] = q[:1, still]
        dq[:, still] = ddq[:, still] = 0.0
        # Bodies that can be: what verdicts ask of a fit is true of them.
        beta = compute_beta(derive_base_parameters(robot), draw_parameters(rng, robot.size))
        friction = np.abs(rng.normal(size=len(library.card.friction)))
        (rigid,) = library.evaluate("torque_regressor", q, dq, ddq)
        (rubbing,) = library.evaluate("friction_regressor", dq)
        tau = rigid @ beta + rubbing @ friction + 0.01 * rng.normal(size=q.shape)
        path = folder / f"still{''.join(map(str, still))}.npz"
        np.savez(path, t=time, q=q, tau=tau)
        return path

    return write


def order(verb, *arguments):
    return (verb, "panda", "--friction", FRICTION, *arguments)


@pytest.mark.parametrize("still", [(0, 1), (0, 2), (1, 4), (5, 6)])
def test_two_joints_still(log, still):
    path = log(*still)
    code, answer = ask(*order("identify", path))
    assert (code, answer["ok"]) == (4, False)
    texts = [entry["text"] for entry in answer["errors"]]
    assert [entry["code"] for entry in answer["errors"][:3]] == [
        "identify.joint-at-rest",
        "identify.joint-at-rest",
        "identify.poor-log",
    ]
    for joint, text in zip(still, texts, strict=False):
        assert f"'joint{joint + 1}'" in text
    told, whole = map(int, re.search(r"(\d+) of (\d+) parameters", texts[2]).groups())
    assert whole == 43 + 21
    named = [name for text in texts[3:] for name in text.split(": ")[1].split(", ")]
    assert len(named) == len(set(named)) == whole - told
    assert {f"{what}{joint + 1}" for joint in still for what in ("Fv", "Fc", "offset")} <= set(named)


def test_what_can_be_told_is_fitted_where_that_is_asked_for(log):
    answer = do(*order("identify", log(1, 4), "--partial"))
    assert answer["ok"]
    told = [entry["name"] for entry in answer["result"]["parameters"]]
    assert "Fv1" in told
    assert "Fv2" not in told


def test_a_static_log(log):
    assert refuse(*order("identify", log(*range(7)))) == (4, ["identify.standstill"])


def test_check_says_it_before(log):
    code, answer = ask(*order("check", log(1, 4)))
    assert code == 4
    assert [entry["code"] for entry in answer["errors"]] == ["check.poor"]
    assert "at rest: joint2, joint5" in next(
        entry["text"] for entry in answer["warnings"] if entry["code"] == "log.not-excited"
    )
    do(*order("check", log()))


def test_a_log_that_moves_what_another_does_not(log):
    answer = do(*order("identify", log(1, 4), log(6)))
    assert answer["ok"]
    assert [entry for entry in answer["warnings"] if entry["code"] == "identify.refused"] == []
    # Neither log can predict the other: stretches of both are held out, not whole logs.
    assert answer["result"]["verdict"]["level"] == "good"
    assert " stretches" in answer["result"]["verdict"]["headline"]
