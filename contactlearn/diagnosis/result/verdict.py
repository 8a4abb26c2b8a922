"""The conclusion of a diagnosis."""

from enum import StrEnum


class Verdict(StrEnum):
    """The conclusion: known effects are missing, nothing is, something unknown is, or the data are wrong."""

    EFFECTS = "effects"
    NONE = "none"
    UNKNOWN = "unknown"
    BAD_DATA = "bad_data"
