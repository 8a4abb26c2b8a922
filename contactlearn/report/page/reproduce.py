"""How a run is made again, as data of its page: command, data, versions and configuration."""

from dataclasses import asdict
from typing import Any

from contactlearn.report.page.recordings import RECORDINGS, has_recordings
from contactlearn.results.provenance import Provenance


def reproduced(provenance: Provenance, use: str = "") -> dict[str, Any]:
    """Return the provenance of a page, and the page of the recordings where the run has written one.

    Args:
        provenance: of the run.
        use: the command that evaluates a model with the missing effects.
    """
    recordings = RECORDINGS if has_recordings(provenance.config) else ""
    return {"use": use, "recordings": recordings, **asdict(provenance)}
