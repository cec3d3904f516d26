"""Elastic joints that others built or simulated: a real coupling, and arms whose models are not symid's."""

from dataclasses import replace

import numpy as np
import pytest

import symid
from benchmarks import couplings
from symid.identification.elastic import ElasticOptions
from symid.identification.elastic.effects import _build_rows, _measure_values, measure_effects
from symid.identification.elastic.regression import DriveEffect, prepare_elastic_signals
from symid.joint_models import run_element
from symid.study.foreign_plant import simulate_plant_runs
from symid.study.foreign_truths import ARMS, build_motions, build_truth, observe_plant, write_arm
from tests.recovery.elastic_runs import identify_by, identify_elastic, run_arm

TRUTH = {"ZZR1": 1.16, "MXR1": 3.0, "MY1": 0.0, "ZZ2": 0.35, "MX2": 0.8, "MY2": 0.0, "IA1": 0.8, "IA2": 0.25}
SIZES = {**TRUTH, "MY1": 3.0, "MY2": 0.8}


@pytest.fixture(scope="module")
def bench(shared_data, load_text):
    robot, data = load_text(couplings.ROBOT, "bench"), np.load(shared_data / "coupling_bench" / "run_b.npz")
    names = {"theta": "theta_motor", "tau": "current", "q": "theta_load"}
    parts = {name: data[column][:25000, None] for name, column in names.items()}
    log = symid.build_log(robot, time=data["t"][:25000], **parts | {"q": -parts["q"]})
    return robot.identify([log]), data


def find_effect(estimate, kind, joint=0):
    (found,) = (entry for entry in estimate.effects if entry.kind == kind and entry.joint in (joint, -1))
    return found


def test_a_linear_coupling_comes_out_linear(bench):
    fit, _ = bench
    (spring,) = fit.estimate.springs
    assert 541.0 < spring.elasticity.stiffness < 567.0
    assert (spring.elasticity.stops, spring.elasticity.knees, spring.elasticity.branches) == ((), (), ())
    assert [fit["ZZ1"].value, fit["IA1"].value] == pytest.approx([4.85e-3] * 2, rel=0.03)
    assert find_effect(fit.estimate, "torque-lag").values[0] == pytest.approx(1e-4, abs=3e-5)
    codes = {notice.code for notice in fit.notices}
    assert {"log.delay-refuted", "elastic.spring-kind"} <= codes


@pytest.mark.parametrize(("kind", "draw"), [("chirp", 101), ("multisine", 102), ("steps", 103)])
def test_couplings_of_another_plant_come_out_linear_however_they_are_driven(kind, draw):
    row = couplings.run(kind, 7, draw)
    assert abs(row.error) < 2.0
    assert row.linear
    assert row.words.startswith(("good", "usable"))


def test_its_effects_are_kept_in_its_file_and_missed_in_an_export(bench, tmp_path):
    fit, _ = bench
    (notice,) = (
        entry for entry in fit.export(tmp_path / "bench.toml").notices if entry.code == "export.effects"
    )
    assert "torque-lag" in notice.text
    assert "link-friction of 'coupling'" in notice.text
    path = fit.save(tmp_path / "fit.json")
    again = symid.load_fit(path)
    assert again.estimate.effects == fit.estimate.effects
    assert again.estimate.springs == fit.estimate.springs
    assert "torque acts late" in str(again)
    path.write_text(path.read_text().replace('"torque-lag"', '"torque-late"'))
    with pytest.raises(symid.errors.EstimateError, match="torque-late of joint -1: no such effect"):
        symid.load_fit(path)


def test_it_predicts_the_other_half_in_the_band_of_its_resonance(bench):
    fit, data = bench
    values = {entry.name: entry.value for entry in fit.estimate.parameters}
    stiffness = fit.estimate.springs[0].elasticity.stiffness
    lag = find_effect(fit.estimate, "torque-lag").values[0]
    drag = find_effect(fit.estimate, "link-friction").values[0]
    period = data["t"][1] - data["t"][0]
    frequency = np.fft.rfftfreq(len(data["t"]), period)
    way = 2j * np.pi * frequency

    def pass_band(signal, order, shift=0.0):
        # A period of the motion is a second: the whole recording is periodic.
        gain = way**order * np.exp(way * shift) / np.sqrt(1.0 + (frequency / 150.0) ** 16)
        return np.fft.irfft(np.fft.rfft(signal - signal.mean()) * gain, len(signal))[25000:47500]

    theta, q, tau = data["theta_motor"], -data["theta_load"], pass_band(data["current"], 0, -lag)
    spring = stiffness * pass_band(theta - q, 0)
    speed = pass_band(theta, 1)
    friction = values["Fv1"] * speed + values["Fc1"] * np.tanh(speed / 0.01)
    motor = tau - values["IA1"] * pass_band(theta, 2) - friction - spring
    link = values["ZZ1"] * pass_band(q, 2) + drag * pass_band(q, 1) - spring
    assert np.std(motor) < 0.04 * np.std(tau)
    assert np.std(link) < 0.012 * np.std(spring)


@pytest.mark.parametrize(("case", "bar"), [("bouc_wen", 0.03), ("lugre", 0.02), ("ripple", 0.02)])
def test_truths_of_another_simulator(shared_data, case, bar):
    folder = shared_data / "foreign_elastic"
    robot, logs = symid.load(folder / "robot.toml"), []
    for name in ("ta10", "tb1", "tb2"):
        data = np.load(folder / case / f"{name}.npz")
        logs.append(symid.build_log(robot, time=data["t"], q=data["q"], theta=data["theta"], tau=data["tau"]))
    estimate = robot.identify(logs).estimate
    for entry in estimate.parameters:
        if entry.name in TRUTH:
            error = abs(entry.value - TRUTH[entry.name])
            assert error < min(0.02 * SIZES[entry.name], 3.0 * entry.std)
    held = np.load(folder / case / "held.npz")
    torsion = held["true_torsion"].copy()
    for effect in estimate.effects:
        if effect.kind == "kinematic-error":
            angle = effect.order * held["theta"][:, effect.joint]
            torsion[:, effect.joint] += effect.values[0] * np.cos(angle) + effect.values[1] * np.sin(angle)
    for spring, phi, torque in zip(estimate.springs, torsion.T, held["true_joint_torque"].T, strict=True):
        error = run_element(spring.elasticity, phi, held["t"], start="fresh").output - torque
        assert np.linalg.norm(error) < bar * np.linalg.norm(torque)


@pytest.fixture(scope="module", params=["load-dependent", "family"])
def unknown(request, c_compiler):
    """Return whether motors have friction that the robot file does not state, their robot and logs."""
    assert c_compiler
    arm, hidden = ARMS["2r"], build_truth(ARMS["2r"], request.param, 1.0)
    motions = build_motions(arm.size, 0.5)[:-1]
    robot, logs = symid.RobotModel(description=write_arm(arm)), []
    for number, run in enumerate(simulate_plant_runs(arm, [hidden] * len(motions), motions)):
        one = observe_plant(run, hidden, np.random.default_rng(number), source="")
        parts = {"q": one.position, "theta": one.motor_position, "tau": one.torque}
        logs.append(symid.build_log(robot, time=one.time, **parts))
    return request.param == "load-dependent", robot, logs


def test_friction_of_motors_that_the_robot_file_does_not_state(unknown, tmp_path):
    other, robot, logs = unknown
    fit = robot.identify(logs)
    codes = {notice.code for notice in fit.notices}
    assert ({"elastic.friction-law", "elastic.friction-drift"} <= codes) == other
    names = [joint.name for joint in robot.description.axes]
    assert [law.law for law in fit.estimate.laws] == (["load-dependent"] * 2 if other else [])
    assert fit.estimate.evidence.drifting == (tuple(names) if other else ())
    for entry in fit.estimate.parameters:
        if entry.name in TRUTH:
            assert abs(entry.value - TRUTH[entry.name]) < 0.02 * SIZES[entry.name]
    if other:
        assert fit.verdict.level == "usable"
        assert "load-dependent" in str(fit)
        assert symid.load_fit(fit.save(tmp_path / "fit.json")).estimate.laws == fit.estimate.laws
        fit.export(tmp_path / "arm.toml")
        taken = [joint.friction.law for joint in symid.load(tmp_path / "arm.toml").description.axes]
        assert taken == [law.law for law in fit.estimate.laws]
        # A law that the call names stays.
        named = identify_by(robot, logs[:1], "weighted", friction="coulomb-viscous")
        assert named.estimate.laws == ()


@pytest.fixture(scope="module")
def run(arm, c_compiler):
    assert c_compiler
    return run_arm(*arm, noisy=True, duration=12.0)


def test_nothing_is_found_in_an_arm_without_effects(arm, run):
    signals = prepare_elastic_signals(run.recording, ElasticOptions(cutoff=100.0))
    assert measure_effects(arm[1], [signals], 60.0, np.zeros(2)) == ()
    robot = symid.load("two_link_elastic")
    for duration in (6.0, 12.0):
        log = robot.simulate(duration=duration, seed=1).log
        assert identify_by(robot, [log], "weighted").estimate.effects == ()


def test_ripple_and_lag_are_found_and_taken_off(arm, run):
    theta, time = run.recording.motor_position, run.recording.time
    late = 0.7e-3
    ripple = 0.3 * np.sin(160.0 * theta[:, 1]) - 0.2 * np.cos(160.0 * theta[:, 1])
    # What acts now was logged earlier.
    torque = np.column_stack([np.interp(time + late, time, part) for part in run.recording.torque.T])
    # A held torque acts on average half a period after its sample.
    torque[:, 1] += np.interp(time + late + 0.5e-3, time, ripple)
    changed = replace(run.recording, torque=torque)
    estimate = identify_elastic(arm[1], [changed], method="weighted")
    found = find_effect(estimate, "torque-ripple", joint=1)
    assert found.order == pytest.approx(160.0, abs=0.1)
    assert np.hypot(*found.values) == pytest.approx(np.hypot(0.3, 0.2), rel=0.1)
    total = find_effect(estimate, "torque-lag")
    assert total.values[0] == pytest.approx(late + 0.5e-3, abs=5.0 * total.deviations[0])
    left = identify_elastic(arm[1], [changed], ElasticOptions(effects=False), method="weighted")
    assert left.effects == ()
    plain = identify_elastic(arm[1], [run.recording], method="weighted")
    for own, other in zip(estimate.parameters, plain.parameters, strict=True):
        assert abs(own.value - other.value) < 3.0 * max(own.std, other.std)


def test_a_torque_that_acts_before_its_sample_is_none_of_a_drive(arm, run):
    time = run.recording.time
    early = np.column_stack([np.interp(time - 5e-3, time, part) for part in run.recording.torque.T])
    signals = prepare_elastic_signals(replace(run.recording, torque=early), ElasticOptions(cutoff=100.0))
    assert "torque-lag" not in {entry.kind for entry in measure_effects(arm[1], [signals], 60.0, np.zeros(2))}
    # Where it is asked for all the same, it is given up after the search.
    assert not [
        *_measure_values(_build_rows(arm[1], [signals], 60.0, np.zeros(2)), [DriveEffect(kind="torque-lag")])
    ]
