"""Progress of long work: what is done, and how long the rest takes."""

import pytest

from symid.environment import report_count


@pytest.mark.parametrize(
    ("pace", "said"),
    [
        (0.1, "joint 1 of 4"),
        (10.0, "joint 1 of 4, 30 s left"),
        (100.0, "joint 1 of 4, 5 min left"),
        (3000.0, "joint 1 of 4, 2.5 h left"),
    ],
)
def test_what_is_left_is_the_rest_at_the_same_pace(pace, said):
    heard, times = [], iter((5.0, 5.0 + pace))
    report_count(heard.append, "joint", clock=lambda: next(times))(1, 4)
    assert heard == [said]


def test_nothing_is_left_at_the_end():
    heard, times = [], iter((0.0, 100.0))
    report_count(heard.append, clock=lambda: next(times))(4, 4)
    assert heard == ["4 of 4"]
