"""Dynamics and springs of any kind found together, on plants that share no code with the models."""

import numpy as np
import pytest

from symid.codegen import prepare_library
from symid.identification import IdentifyOptions, TaskContext, prepare_elastic_methods
from symid.identification.elastic.methods import AUTOMATIC_METHODS
from symid.identification.hysteresis import ElementPath, choose_spring
from symid.joint_models import Elasticity, run_element
from symid.study.foreign_truths import _prepare_scene, observe_plant
from tests.recovery.elastic_runs import identify_by
from tests.recovery.written_out_arm import TRUTH, build, simulate


@pytest.fixture(scope="module")
def scene():
    return _prepare_scene("2r", "cubic", 1.0, 0.2)


@pytest.fixture(scope="module")
def found(scene):
    logs = [
        observe_plant(run, scene.hidden, np.random.default_rng([6, number]), source=name)
        for number, (name, run) in enumerate(zip(scene.names[:-1], scene.runs[:-1], strict=True))
    ]
    context = TaskContext(prepare=prepare_library, progress=lambda _: None)
    return prepare_elastic_methods(scene.robot, logs, IdentifyOptions(), context)("automatic").estimate


def test_cubic_springs_with_stops_are_used_for_the_dynamics(scene, found):
    assert found.method == "simultaneous"
    # The one-shot problem has no such springs.
    assert {trial.method for trial in found.trials} == {*AUTOMATIC_METHODS, "simultaneous"} - {"nlp"}
    values = {entry.name: entry for entry in found.parameters}
    for name, (true, size) in scene.values.items():
        assert abs(values[name].value - true) < min(4.0 * values[name].std, 5e-3 * size), name
    held = scene.runs[-1]
    for joint, spring in enumerate(found.springs):
        true = held.joint_torque[:, joint]
        left = run_element(spring.elasticity, held.torsion[:, joint], held.time).output - true
        assert np.linalg.norm(left) < 0.01 * np.linalg.norm(true)


def test_an_asymmetric_spring_of_another_plant_is_found():
    """Its rate is 1 - z^2 (3/4 sign(z dx) + 1/4 + 1/5 sign(z)): loading and unloading are asymmetric."""
    plant = _prepare_scene("2r", "asymmetric-bouc-wen", 1.0, 0.05)
    run = plant.runs[0]
    period = np.full(len(run.time), run.time[1] - run.time[0])
    for phi, torque in zip(run.torsion.T, run.joint_torque.T, strict=True):
        path = ElementPath(position=phi, velocity=np.gradient(phi, run.time), period=period)
        kept = np.ones(len(phi), dtype=bool)
        spring, name, left, _ = choose_spring(
            path, torque, kept, Elasticity(stiffness=5000.0), np.zeros(len(torque))
        )
        (branch,) = spring.branches
        assert name == "bouc-wen"
        assert left < 0.1
        assert [branch.sharpness, branch.loop] == pytest.approx([2.0, 0.75], rel=0.02)
        assert [branch.skew, branch.lean] == pytest.approx([0.2, 0.2], abs=0.01)


def test_rigid_joints_and_known_dynamics(mixed):
    log = build(mixed, simulate(12.0, 3))
    plain = identify_by(mixed, log, "weighted")
    fit = identify_by(mixed, log, "simultaneous", known={"IA1": TRUTH["IA1"]})
    assert fit["IA1"].std == 0.0
    for entry in fit.estimate.parameters:
        assert abs(entry.value - TRUTH[entry.name]) <= 4.0 * entry.std, entry
    # What the springs tell comes on top of what is known without them.
    assert fit["ZZR1"].std < plain["ZZR1"].std
    assert len(fit.springs) == 1
