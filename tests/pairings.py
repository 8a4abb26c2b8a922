"""Cases for `parametrize` that have every value of several axes without all of their combinations."""

import pytest
from _pytest.mark import ParameterSet


def paired(*axes):
    """Cases for `parametrize` in which each value of each axis occurs, as many as the longest axis has values.

    Args:
        axes: values, cases of `pytest.param`, or values by their names; a tuple is of several arguments.
    """
    named = [[*(axis if isinstance(axis, dict) else dict(map(_named, axis))).items()] for axis in axes]
    cases = []
    for k in range(max(map(len, named))):
        names, values = zip(*(axis[k % len(axis)] for axis in named), strict=True)
        flat = [part for value in values for part in (value if isinstance(value, tuple) else (value,))]
        cases.append(pytest.param(*flat, id="-".join(names)))
    return cases


def _named(value):
    return (value.id, value.values) if isinstance(value, ParameterSet) else (str(value), value)
