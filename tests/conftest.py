"""Fixtures that several test files share."""

import os

import pytest
import torch

from contactlearn.data import ellipse_drops as source
from contactlearn.errors import DataError

torch.set_num_threads(1)  # the suite runs in parallel processes


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
