"""Errors that tests ask for, with the codes of their notices."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest


@contextmanager
def raises(error: type[Exception], *codes: str, match: str | None = None) -> Iterator[pytest.ExceptionInfo]:
    """Expect an error whose notices have these codes, in this order; its text has `match` in it."""
    with pytest.raises(error, match=match) as caught:
        yield caught
    assert [notice.code for notice in caught.value.notices] == list(codes)
