"""The conclusion of a diagnosis."""

from enum import StrEnum


class Verdict(StrEnum):
    """The conclusion: known effects are missing, nothing is, something unknown is, or the data are wrong.

    Unfinished: something is missing, and the search ran out of time before it had compared all known effects.
    """

    EFFECTS = "effects"
    NONE = "none"
    UNKNOWN = "unknown"
    UNFINISHED = "unfinished"
    BAD_DATA = "bad_data"
