"""Provenance of a result: the data, versions, configuration and command that it came from."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

FORMAT = 2
"""Number of the format of result files; a file without one is of format 1."""


class RunKind(StrEnum):
    """The kind of a run: the command that made it, evaluate having two."""

    TRAINING = "training"
    EVALUATION = "evaluation"
    TRANSFER = "transfer"
    DIAGNOSIS = "diagnosis"


@dataclass(frozen=True, kw_only=True)
class DataSource:
    """The impacts of a run: their source in words, their number, and the SHA-256 of all their numbers and names."""

    source: str
    trials: int
    sha256: str


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """Everything that is needed to make a result again.

    Args:
        data: the impacts.
        versions: of this program, Python and the libraries that compute, by name.
        config: the composed configuration, resolved.
        command: the line that was typed.
        device: that computed it, a GPU with its name.
    """

    data: DataSource
    versions: Mapping[str, str] = field(default_factory=dict)
    config: Mapping[str, Any] = field(default_factory=dict)
    command: str = ""
    device: str = "cpu"
