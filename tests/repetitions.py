"""Repetitions of a test: some of them in `make test`, all of them in `make test-all`."""

from itertools import product

import pytest
from _pytest.mark import ParameterSet


def repeated(first, *others):
    """Values for `parametrize`, of which all but the first are nightly."""
    return [first, *(pytest.param(other, marks=pytest.mark.nightly) for other in others)]


def crossed(*axes):
    """All combinations for `parametrize`, of which those are nightly that `make test` need not have.

    It has each value of each axis in some combination.

    Args:
        axes: values, cases of `pytest.param`, or values by their names; a tuple is of several arguments.
    """
    named = [axis if isinstance(axis, dict) else dict(map(_named, axis)) for axis in axes]
    longest = max(map(len, named))
    kept = {tuple([*axis][k % len(axis)] for axis in named) for k in range(longest)}
    found = []
    for names in product(*named):
        values = [axis[name] for axis, name in zip(named, names, strict=True)]
        flat = [part for value in values for part in (value if isinstance(value, tuple) else (value,))]
        found.append(pytest.param(*flat, id="-".join(names), marks=() if names in kept else pytest.mark.nightly))
    return found


def _named(value):
    return (value.id, value.values) if isinstance(value, ParameterSet) else (str(value), value)
