"""Result of the command diagnose: the diagnosis, where it came from, and how to use it."""

from dataclasses import dataclass

from contactlearn.diagnosis.result import Diagnosis
from contactlearn.results.provenance import FORMAT, Provenance, RunKind


@dataclass(frozen=True, kw_only=True)
class DiagnosisRun:
    """A diagnosis as diagnosis.json holds it; its record of impacts and models lies beside the file.

    `use` is the command that evaluates the diagnosed model on the same data.
    """

    kind: RunKind = RunKind.DIAGNOSIS
    format: int = FORMAT
    provenance: Provenance
    use: str
    diagnosis: Diagnosis
