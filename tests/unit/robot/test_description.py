"""What every robot must hold, whoever builds it."""

from dataclasses import replace

import pytest

from symid.errors import RobotError
from symid.robot.description import Robot
from tests.chains import TWO_LINK, build_chain


@pytest.mark.parametrize(
    ("build", "text"),
    [
        (lambda: Robot(name="none", joints=()), "one joint"),
        (lambda: build_chain([(0.0, "q1", 0, "q")]), "'q1'"),
        (lambda: replace(TWO_LINK, joints=TWO_LINK.joints[:1] * 2), "called 'joint1'"),
        (lambda: replace(TWO_LINK, joints=TWO_LINK.joints[1:]), "'joint2': .*parent"),
    ],
)
def test_impossible_robots_are_refused(build, text):
    with pytest.raises(RobotError, match=text) as caught:
        build()
    assert caught.value.notices[0].code == "robot.invalid"
