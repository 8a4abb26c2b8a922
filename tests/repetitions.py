"""Repetitions of a statistical test: the first in `make test`, all of them in `make test-all`."""

import pytest


def repeated(first, *others):
    """Values for `parametrize`, of which all but the first are nightly."""
    return [first, *(pytest.param(other, marks=pytest.mark.nightly) for other in others)]
