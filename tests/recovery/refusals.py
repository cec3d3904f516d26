"""What is refused, and by which notices."""

from contextlib import contextmanager

import pytest


@contextmanager
def raises(error, *codes, match=None):
    """Expect an error with notices of these codes, in this order."""
    with pytest.raises(error, match=match or None) as caught:
        yield caught
    assert [notice.code for notice in caught.value.notices] == [*codes]
