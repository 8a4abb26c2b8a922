"""Fixtures that several test files share."""

import os

import pytest

from contactlearn.data import ellipse_drops as source
from contactlearn.errors import DataError


@pytest.fixture(scope="session")
def ellipse_drops():
    """The published drops, from CONTACTLEARN_DATA or the download cache.

    The one legitimate skip: no CONTACTLEARN_DATA, nothing in the cache and no network.  A wrong
    CONTACTLEARN_DATA, or a file that is not the published one, fails.
    """
    if os.environ.get("CONTACTLEARN_DATA"):
        return source.load()
    try:
        path = source.find()
    except DataError as error:
        pytest.skip(f"the published drops cannot be had: {error}")
    return source.load(path.parent)
