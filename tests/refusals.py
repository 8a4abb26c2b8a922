"""Errors whose messages name a rule, a value and a fix."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import pytest

from contactlearn.core.errors import ContactLearnError, DataError


@contextmanager
def refused(fragments: Iterable[str], error: type[ContactLearnError] = DataError) -> Iterator[pytest.ExceptionInfo]:
    """Expect an error whose message has all fragments."""
    with pytest.raises(error) as caught:
        yield caught
    for fragment in fragments:
        assert fragment in str(caught.value)
