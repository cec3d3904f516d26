"""Errors and notices that tests ask for."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

import pytest

from symid.errors import Notice, SymidError


@contextmanager
def raises(error: type[Exception], *codes: str, match: str | None = None) -> Iterator[pytest.ExceptionInfo]:
    """Expect an error whose notices have these codes, in this order; its text has `match` in it."""
    with pytest.raises(error, match=match or None) as caught:
        yield caught
    assert [notice.code for notice in caught.value.notices] == list(codes)


def tell(notices: Iterable[Notice]) -> dict[str, str]:
    """Return the text of each notice by its code."""
    return {notice.code: notice.text for notice in notices}


def refuse(error: type[SymidError], function: Callable[..., object], *arguments, **options) -> dict[str, str]:
    """Return what the notices of an error say, by their codes, that a call must give."""
    with pytest.raises(error) as caught:
        function(*arguments, **options)
    return tell(caught.value.notices)
