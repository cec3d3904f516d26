"""Texts with a mistake whose place is marked by "^", and the notices of calls that are refused."""

from collections.abc import Callable, Sequence
from typing import Any

import pytest

from symid.errors import Notice, RobotError, SymidError
from symid.robot.description import Robot


def refuse(
    call: Callable[..., object], *arguments: Any, error: type[SymidError] = RobotError, **options: Any
) -> Sequence[Notice]:
    """Return what a call that must be refused is told."""
    with pytest.raises(error) as caught:
        call(*arguments, **options)
    return caught.value.notices


def take_mark(text: str) -> tuple[str, tuple[int, int]]:
    """Return a text without its mark "^", and the line and column that it stood at."""
    before, mark, after = text.partition("^")
    assert mark, text
    return before + after, (before.count("\n") + 1, len(before) - before.rfind("\n"))


def find_text(robot: Robot, code: str) -> str:
    """Return the first notice of this code about a robot that was read."""
    return next(str(notice) for notice in robot.notices if notice.code == code)
