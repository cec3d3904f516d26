"""The demo's own verdict: it ends well only if it has reason to."""

from dataclasses import replace

import pytest

from symid.cli.demo import _judge
from symid.identification.estimate import Estimate, Outcome, ParameterEstimate, Residual, Validation

ENTRY = ParameterEstimate(name="ZZ1", value=1.0, std=0.1, unit="kg m^2", truth=1.2)
RESIDUAL = Residual(joint="elbow", norm=1.0, relative_percent=5.0, std=0.5, samples=10, unit="N m")


@pytest.fixture
def estimate():
    """Return an estimate two standard deviations from the truth."""
    return Estimate(
        robot="arm",
        signature="0",
        rows="torque",
        estimator="ols",
        friction=("none",),
        parameters=(ENTRY,),
        residual=(RESIDUAL,),
        condition=1.0,
        outcome=Outcome.SOLVED,
        samples=10,
        sources=("a.npz",),
        settings={},
    )


@pytest.fixture
def validation():
    """Return a validation with a residual of 0.5 N m."""
    return Validation(
        robot="arm", signature="0", source="b.npz", rows="torque", residual=(RESIDUAL,), series=(), samples=10
    )


def test_near_the_truth_and_at_the_noise_is_well(estimate, validation):
    assert _judge(estimate, validation, 0.5) == ()


def test_far_from_the_truth_is_not(estimate, validation):
    far = replace(estimate, parameters=(replace(ENTRY, truth=1.31),))
    (notice,) = _judge(far, validation, 0.5)
    assert notice.code == "demo.off-truth"
    assert "ZZ1" in notice.text


def test_above_the_noise_is_not(estimate, validation):
    (notice,) = _judge(estimate, validation, 0.3)
    assert notice.code == "demo.above-noise"
    assert "elbow" in notice.text
