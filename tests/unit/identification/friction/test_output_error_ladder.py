"""The ladder of laws on a simulated axis: the law that made the motion leaves least of it."""

import numpy as np
import pytest

from symid.errors import LogError
from symid.identification.friction.estimators import fit_friction
from symid.identification.friction.output_error import (
    AxisModel,
    build_axis_run,
    build_axis_samples,
    simulate_axis,
)
from symid.identification.friction.selection import compute_relative_residual
from symid.joint_models.friction_catalogue import get_law
from symid.logs.recording import Recording
from symid.robot.description import Decimation, Processing

PERIOD = 1e-3
PROCESSING = Processing(
    filter_order=4,
    filter_cutoff=100.0,
    filter_torque=False,
    drop_first=50,
    decimation=Decimation(factor=10, order=8, ripple_db=0.05, band=0.8),
)


def build_recording(phase, joints=1):
    time = 2.0 + PERIOD * np.arange(6000)
    model = AxisModel(law=get_law("asymmetric"), terms=("drift",))
    values = np.array([95.0, 160.0, 20.0, 240.0, 21.0, -0.2])
    # Strong enough that the axis hardly rests: at rest the force tells nothing of a law.
    force = 250.0 * np.sin(4.0 * time + phase) + 60.0 * np.sin(1.3 * time)
    position, _ = simulate_axis(model, values, force, PERIOD, (0.0, 0.0, 2.0))
    return Recording(
        time=time,
        position=np.column_stack([position] * joints),
        torque=np.column_stack([force] * joints),
        source="simulated",
    )


def test_the_law_that_made_the_motion_leaves_least():
    fitted, unseen = (
        build_axis_samples(build_recording(phase), PROCESSING, terms=("drift",)) for phase in (1.0, 0.6)
    )
    assert fitted.extra_names == ("M", "drift")
    laws = [get_law(name) for name in ("coulomb-viscous-offset", "asymmetric")]
    estimates = [fit_friction(fitted, law) for law in laws]
    for samples in (fitted, unseen):
        plain, rich = map(compute_relative_residual, (samples, samples), laws, estimates)
        assert rich < 0.5 * plain
    # What is left comes from the filter, which blurs each change of the direction.
    assert estimates[1].other[0] == pytest.approx(95.0, rel=0.01)
    assert estimates[1].other[1] == pytest.approx(-0.2, abs=0.05)


def test_a_run_is_the_recording():
    recording = build_recording(0.0)
    run = build_axis_run(recording)
    assert np.array_equal(run.position, recording.position[:, 0])
    assert np.array_equal(run.force, recording.torque[:, 0])
    assert (run.period, run.begin) == (pytest.approx(PERIOD), 2.0)


@pytest.mark.parametrize("build", [build_axis_run, lambda entry: build_axis_samples(entry, PROCESSING)])
def test_one_joint_is_wanted(build):
    with pytest.raises(LogError, match=r"\b2 joints.* 1$") as caught:
        build(build_recording(0.0, joints=2))
    assert caught.value.notices[0].code == "log.joints"
