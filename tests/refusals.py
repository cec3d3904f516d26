"""What a call must refuse: the error, and the code of its first notice."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from symid.errors import SymidError


@contextmanager
def raises(
    error: type[SymidError], code: str, match: str | None = None
) -> Iterator[pytest.ExceptionInfo[SymidError]]:
    """Expect an error whose first notice has the code, and whose text matches."""
    with pytest.raises(error, match=match) as caught:
        yield caught
    assert caught.value.notices[0].code == code
