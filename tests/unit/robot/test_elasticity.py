"""The spring of an elastic joint refuses what no spring is."""

import pytest

from symid.errors import RobotError
from symid.joint_models.hysteresis import Elasticity, Knee, Stop


def test_the_initial_stiffness_adds_all_stops():
    stops = (Stop(threshold=0.002, stiffness=120.0), Stop(threshold=0.005, stiffness=60.0))
    assert Elasticity(stiffness=380.0, stops=stops).initial_stiffness == 560.0
    assert Elasticity(stops=stops).initial_stiffness is None


@pytest.mark.parametrize(
    ("stops", "knees", "said"),
    [
        ((0.005, 0.002), (), "of stops"),
        ((0.0,), (), "of stops"),
        ((float("nan"),), (), "of stops"),
        ((), ((0.0, 0.5),), "of knees"),
        ((), ((2.0, 0.5), (1.0, 0.5)), "of knees"),
        ((), ((1.0, -0.5), (2.0, -0.6)), "beyond 2 .* -0.1"),
        ((), ((-2.0, -0.6), (-1.0, -0.5)), "beyond -2 .* -0.1"),
    ],
)
def test_what_is_no_spring_is_refused(stops, knees, said):
    with pytest.raises(RobotError, match=said) as caught:
        Elasticity(
            stiffness=1.0,
            stops=tuple(Stop(threshold=threshold) for threshold in stops),
            knees=tuple(Knee(threshold=threshold, slope=slope) for threshold, slope in knees),
        )
    assert caught.value.notices[0].code == "robot.invalid-elasticity"
