"""The demo's own verdict: it ends well only if it has reason to."""

import numpy as np
import pytest

from symid.api.first_steps import judge_demo
from symid.identification.elastic.validation import TrackingRun


def follow(*sizes):
    return tuple(TrackingRun(name=str(size), time=np.zeros(1), error=np.full((1, 2), size)) for size in sizes)


def test_near_the_truth_and_better_than_rigid_is_well():
    assert judge_demo((1.9, 2.9), follow(0.01, 0.001)) == ()


@pytest.mark.parametrize(
    ("parameters", "hysteresis", "sizes", "code"),
    [
        (2.1, 1.0, (0.01, 0.001), "demo.off-truth"),
        (float("nan"), 1.0, (0.01, 0.001), "demo.off-truth"),
        (1.0, 3.1, (0.01, 0.001), "demo.off-spring"),
        (1.0, float("nan"), (0.01, 0.001), "demo.off-spring"),
        (1.0, 1.0, (0.01, 0.02), "demo.no-gain"),
    ],
)
def test_far_off_or_no_better_than_rigid_is_not(parameters, hysteresis, sizes, code):
    (notice,) = judge_demo((parameters, hysteresis), follow(*sizes))
    assert notice.code == code
