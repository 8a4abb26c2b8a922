"""The audit command: what is wrong with measurements, and which setting corrects it."""

from omegaconf import DictConfig

from contactlearn.cli.commands.loading import load_data
from contactlearn.data.audit.findings import audit
from contactlearn.report.text import sentence, stages


def audit_text(cfg: DictConfig) -> str:
    """Return the findings of the audit in words, a line each, and the setting that corrects what can be corrected.

    Args:
        cfg: the `data` part of a configuration.

    Raises:
        ContactLearnError: see `load_data`.
    """
    impacts = load_data(cfg, validate=False)
    findings = audit(impacts)
    lines = [f"{impacts.source}: {len(impacts)} impacts"]
    lines += [f"{'wrong' if finding.mistake else 'note'}: {sentence(finding.sentence)}" for finding in findings]
    lines += [] if findings else [f"note: {stages.CONSISTENT}"]
    setting = stages.correct_setting(cfg.get("correct") or (), findings)
    lines += [f"to correct it: {setting} on any command"] if setting else []
    return "\n".join(lines).replace("\u00a0", " ")
