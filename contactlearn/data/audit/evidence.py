"""The moment balance behind findings about units, axes and inertia, for figures that compute nothing."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.data.audit.contradictions import contradictions
from contactlearn.data.audit.corrections import correct
from contactlearn.data.audit.moments import Balance, balance, torque
from contactlearn.data.audit.result import Finding
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.space import PLANE

_OF_BALANCE = ("impossible", "inertia_scaled", "moment_balance_open", "contradictions", "consistent")


@dataclass(frozen=True, kw_only=True)
class BalanceSide:
    """Both sides of the moment balance of each trial, r_x P_n − r_y P_t and I Δω in N m s, and how it closes.

    Args:
        moments: [2, n].
        fit: both coefficients.
        contradictions: mean of each question.
    """

    moments: Float[Tensor, "2 n"]
    fit: Balance
    contradictions: Mapping[str, float]

    @classmethod
    def of(cls, impacts: Impacts) -> "BalanceSide":
        """Return the balance of impacts."""
        terms = torque(impacts)
        means = {question: answer.mean().item() for question, answer in contradictions(impacts).items()}
        moments = impacts.inertia * torch.stack((terms.normal + terms.tangential, terms.spin))
        return cls(moments=moments, fit=balance(impacts), contradictions=means)


@dataclass(frozen=True, kw_only=True)
class BalanceEvidence:
    """The moment balance without a correction, and with it; `after` is None where nothing changes."""

    before: BalanceSide
    after: BalanceSide | None


def balance_evidence(findings: Sequence[Finding], raw: Impacts) -> dict[str, BalanceEvidence]:
    """Compute the evidence of the findings about the balance by name; none in space, where nothing is compared.

    Args:
        findings: in the order in which their corrections were applied.
        raw: impacts before these corrections.
    """
    found, impacts = dict[str, BalanceEvidence](), raw.replace(validate=False)
    for finding in findings if raw.space is PLANE else ():
        after = correct(impacts, [finding.correction] if finding.correction else finding.hypothesis)
        if finding.hypothesis or finding.name in _OF_BALANCE:
            changed = None if after is impacts else BalanceSide.of(after)
            found[finding.name] = BalanceEvidence(before=BalanceSide.of(impacts), after=changed)
        impacts = after
    return found
