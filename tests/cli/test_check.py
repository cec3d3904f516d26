"""`symid check` finds what is wrong with a log, says it plainly, and makes uneven logs even."""

import json

import numpy as np
import pytest

from symid.cli.main import run
from symid.codegen.cache import prepare_library
from symid.robot.toml_reader import read_robot
from tests.calls import ask, do, fail


def codes(answer):
    return {notice["code"]: notice["text"] for notice in answer["warnings"]}


@pytest.fixture(scope="module")
def columns(project):
    """Return t, q, tau of two_link moving: torques of the file's own parameters, 1 % of noise."""
    robot = read_robot(project / "robots" / "two_link.toml")
    library = prepare_library(robot)
    t = np.arange(12000) * 1e-3
    angles = 2.0 * np.pi * np.outer(t, [0.3, 0.7, 1.1])
    size = np.array([[0.9, 0.3, 0.1], [-0.5, 0.4, 0.2]])
    phase = np.array([[0.2, 1.0, 2.0], [0.7, 0.1, 1.3]])
    rate = 2.0 * np.pi * np.array([0.3, 0.7, 1.1])
    wave = [angles + row for row in phase]
    q = np.column_stack([np.sin(w) @ a for w, a in zip(wave, size, strict=True)])
    dq = np.column_stack([(np.cos(w) * rate) @ a for w, a in zip(wave, size, strict=True)])
    ddq = np.column_stack([(-np.sin(w) * rate**2) @ a for w, a in zip(wave, size, strict=True)])
    beta = np.array([entry.value for entry in library.card.beta])
    friction = np.array([entry.value for entry in library.card.friction])
    tau = library.evaluate("torque_regressor", q, dq, ddq)[0] @ beta
    tau = tau + library.evaluate("friction_regressor", dq)[0] @ friction
    noise = np.random.default_rng(5).normal(size=tau.shape) * 0.01 * np.sqrt(np.mean(tau**2, axis=0))
    return {"t": t, "q": q, "tau": tau + noise}


@pytest.fixture
def write(tmp_path, columns):
    """Return a writer of logs with some columns changed."""

    def build(name="log.npz", **changes):
        np.savez(tmp_path / name, **{**columns, **changes})
        return tmp_path / name

    return build


def test_a_good_log(write):
    answer = do("check", "two_link", write())
    assert (answer["ok"], answer["warnings"]) == (True, [])
    (entry,) = answer["result"]["logs"]
    assert entry["timing"]["even"]
    assert [joint["name"] for joint in entry["joints"]] == ["shoulder", "elbow"]
    found = answer["result"]["excitation"]
    assert found["rank"] == len(found["singular_values"]) == 12
    assert found["condition"] < 100
    # An offset beside Coulomb friction and some small moments are hardly excited; nothing is refused.
    assert {entry["verdict"] for entry in found["parameters"]} <= {
        "identifiable",
        "poorly identifiable",
    }
    (dynamics,) = answer["result"]["dynamics"]
    assert dynamics["causes"] == []
    for entry in dynamics["signs"]:
        assert entry["inertia"] > 3.0 * entry["inertia_std"]
        assert entry["friction"] > 3.0 * entry["friction_std"]
    assert not dynamics["torque_delay"]["late"]


def test_expected_deviations_are_those_of_an_identification(capsys, write):
    log = write()
    answer = do("check", "two_link", log)
    expected = {e["name"]: e["relative_std_percent"] for e in answer["result"]["excitation"]["parameters"]}
    assert run(["identify", "two_link", str(log), "--estimator", "wls", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["result"]["parameters"]
    ratios = [expected[entry["name"]] / entry["relative_std_percent"] for entry in found]
    assert len(ratios) == 12
    assert all(0.5 < ratio < 2.0 for ratio in ratios)


@pytest.mark.parametrize("joint", [0, 1])
def test_a_wrong_sign(write, columns, joint):
    turned = columns["tau"] * np.where(np.arange(2) == joint, -1.0, 1.0)
    code, answer = ask("check", "two_link", write(tau=turned))
    text = codes(answer)["log.torque-sign"]
    assert code == 0
    assert f" joint {('shoulder', 'elbow')[joint]!r} " in text
    assert "[log.torque]" in text


@pytest.mark.parametrize("swapped", [("tau",), ("q",)])
def test_exchanged_joints(write, columns, swapped):
    code, answer = ask("check", "two_link", write(**{name: columns[name][:, ::-1] for name in swapped}))
    found = codes(answer)
    assert code == 0
    assert "log.swapped-joints" in found or "log.torque-sign" in found
    if "log.swapped-joints" in found:
        assert "of 'shoulder' and 'elbow'" in found["log.swapped-joints"]


@pytest.mark.parametrize("delay", [3.4e-3, -2.6e-3])
def test_a_delay_is_found_to_a_part_of_a_sample(write, columns, delay):
    late = np.column_stack([np.interp(columns["t"] - delay, columns["t"], tau) for tau in columns["tau"].T])
    code, answer = ask("check", "two_link", write(tau=late))
    found = answer["result"]["dynamics"][0]["torque_delay"]
    assert code == 0
    assert found["late"]
    assert found["delay"] == pytest.approx(delay, abs=max(3 * found["std"], 2e-4))
    assert found["std"] < 5e-4
    side = "after" if delay > 0 else "before"
    assert f"ms {side} the motion" in codes(answer)["log.torque-delay"]


def test_units_that_no_robot_has(write, columns):
    answer = do("check", "two_link", write(tau=1e6 * columns["tau"]))
    assert "joint 'shoulder'" in codes(answer)["log.torque-size"]
    assert " kg, " in codes(answer)["log.torque-size"]
    assert "milliamperes" in codes(answer)["log.torque-size"]
    assert "motor side" in codes(do("check", "two_link", write(tau=1e-6 * columns["tau"])))["log.torque-size"]


@pytest.mark.parametrize(("factor", "said"), [(0.1, True), (10.0, True), (1.0, False), (2.0, False)])
def test_torques_that_masses_of_the_robot_file_do_not_explain(write, columns, factor, said):
    """Efforts that are currents: the masses that they need are those of another robot."""
    answer = do("check", "two_link", write(tau=factor * columns["tau"]))
    assert ("log.effort-size" in codes(answer)) == said
    if said:
        assert "--units torque=A" in codes(answer)["log.effort-size"]


def test_a_static_log_ends_with_4(write, columns):
    still = np.tile(columns["q"][:1], (len(columns["t"]), 1))
    code, answer = ask("check", "two_link", write(q=still))
    assert (code, answer["ok"]) == (4, False)
    assert answer["errors"][0]["code"] == "identify.standstill"
    assert answer["result"]["logs"][0]["samples"] == 12000


def test_a_joint_at_rest_is_named(write, columns):
    q = columns["q"] * [1.0, 0.0]
    code, answer = ask("check", "two_link", write(q=q))
    assert (code, answer["errors"][0]["code"]) == (4, "check.poor")
    text = codes(answer)["log.not-excited"]
    assert text.startswith("9 of 12 ")
    assert "at rest: elbow" in text
    refused = [
        e["name"] for e in answer["result"]["excitation"]["parameters"] if e["verdict"] == "not identifiable"
    ]
    assert {"Fv2", "Fc2", "offset2"} <= set(refused)


def test_noise_that_drowns_all_ends_with_4(write, columns):
    noise = np.random.default_rng(2).normal(size=columns["tau"].shape)
    code, answer = ask("check", "two_link", write(tau=noise))
    assert code in (0, 4)
    assert "log.faint-parameters" in codes(answer)
    if code == 4:
        assert answer["errors"][0]["code"] == "check.nothing"


def test_elastic_joints_are_not_looked_at_as_rigid_ones(write):
    assert "check.elastic" in codes(do("check", "two_link_elastic", write()))


def test_runs_are_checked_together(write, tmp_path):
    write("a.npz")
    path = tmp_path / "runs.toml"
    path.write_text(
        '[[run]]\nfile = "a.npz"\ndrop_last = 6000\n[[run]]\nfile = "a.npz"\ndrop_first = 6000\noffset = 0\n'
    )
    answer = do("check", "two_link", path)
    assert len(answer["result"]["logs"]) == 2
    assert [entry["samples"] for entry in answer["result"]["logs"]] == [6000, 6000]
    assert answer["result"]["excitation"]["rank"] == 12
    path.write_text("[[run]]\n")
    code, answer = ask("check", "two_link", path)
    assert (code, answer["errors"][0]["code"], answer["errors"][0]["line"]) == (3, "runs.missing-key", 1)


class TestTimes:
    """Uneven logs are looked at, and made even on request."""

    @pytest.fixture
    def uneven(self, write, columns):
        """Return a log with jitter, lost and repeated samples and a clock that was set back."""
        rng = np.random.default_rng(8)
        kept = np.sort(rng.choice(len(columns["t"]), size=11800, replace=False))
        kept = np.insert(kept, 500, kept[500])
        times = columns["t"][kept] + 0.3e-3 * rng.uniform(size=len(kept))
        times[500] = times[501]
        return write(
            t=1e3 * times,
            q=columns["q"][kept],
            tau=columns["tau"][kept],
            units=np.array(["t [ms]"]),
            note=np.ones(3),
        )

    def test_it_is_checked_as_if_even(self, uneven):
        code, answer = ask("check", "two_link", uneven)
        found = codes(answer)
        assert code == 0
        assert "samples have the time of the one before" in found["log.repeated-times"]
        assert "--resample FILE" in found["log.gap"]
        assert "at the even times of a clock" in found["log.resampled"]
        assert not answer["result"]["logs"][0]["timing"]["even"]
        assert answer["result"]["excitation"]["rank"] == 12

    def test_the_copy_is_even_and_keeps_names_and_units(self, uneven, tmp_path, columns):
        output = tmp_path / "even.npz"
        answer = do("check", "two_link", uneven, "--resample", output)
        assert answer["result"]["resampled"]["file"] == str(output)
        with np.load(output) as copy:
            assert set(copy.files) == {"t", "q", "tau", "note", "units"}
            t, q = copy["t"] * 1e-3, copy["q"]
        assert np.ptp(np.diff(t)) < 1e-9
        truth = np.column_stack([np.interp(t, columns["t"], column) for column in columns["q"].T])
        assert np.abs(q - truth).max() < 0.01
        assert do("check", "two_link", output)["result"]["logs"][0]["timing"]["even"]

    def test_one_log_at_a_time(self, uneven, tmp_path):
        assert fail("check", "two_link", uneven, uneven, "--resample", tmp_path / "even.npz") == (
            2,
            "usage.one-log",
        )

    def test_arrays_do_not_fit_into_a_table(self, uneven, tmp_path):
        assert fail("check", "two_link", uneven, "--resample", tmp_path / "even.csv") == (
            3,
            "output.no-table",
        )


@pytest.mark.parametrize(
    ("robot", "log"),
    [("tx40", "tx40/tx40.npz"), ("emps", "emps/DATA_EMPS.mat"), ("kr300", "kr300/run_a.npz")],
)
def test_real_logs_have_their_signs_and_order(shared_data, robot, log):
    answer = do("check", robot, shared_data / log)
    assert not {"log.torque-sign", "log.swapped-joints", "log.torque-size"} & set(codes(answer))
    assert answer["result"]["excitation"]["rank"] == len(answer["result"]["excitation"]["singular_values"])


@pytest.mark.parametrize("joint", [0, 1, 2, 3, 5])
def test_a_wrong_sign_in_a_real_log(shared_data, tmp_path, joint):
    with np.load(shared_data / "tx40" / "tx40.npz") as log:
        content = dict(log)
    # Every fourth sample will do. Motor 6 moves joints 5 and 6, whose torques are both wrong then.
    content = {name: values[::4].copy() for name, values in content.items()}
    content["tau_motor"][:, joint] *= -1.0
    np.savez(tmp_path / "turned.npz", **content)
    cut = ["--set", "processing.drop_first=600", "--set", "processing.decimation.factor=25"]
    found = codes(do("check", "tx40", tmp_path / "turned.npz", *cut))
    # Joints 1 and 4 carry no weight: the sign of their positions is as good an explanation.
    text = found["log.several-causes" if joint in {0, 3} else "log.torque-sign"]
    assert f"the torque of joint 'joint{joint + 1}' has the wrong sign" in text or joint == 5
    assert joint != 5 or "motor 6, which moves 'joint5' and 'joint6'" in text
    assert text.count("; or ") == (joint in {0, 3})
