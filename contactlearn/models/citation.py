"""BibTeX of the law, effects and methods behind a model.

Laws and effects name their sources by the keys of references.bib in `citations`; a law or an effect of another package
may give whole BibTeX entries there instead.
"""

import re
from functools import cache
from importlib.resources import files

from contactlearn.core.errors import UnknownNameError
from contactlearn.laws import Law
from contactlearn.models.contact_model import ContactModel
from contactlearn.models.gp.sparse import SparseGPs

_PAPER = ("fazeli2017",)
_JOINT_FIT = ("lange1989", "mackinnon1985", "boggs1987", "fuller1987", "carroll2006")
_PROCESSES = ("rasmussen2006", "gardner2018")
_SPARSE = ("titsias2009", "burt2020")


def cite(model: ContactModel | Law) -> str:
    """Return the BibTeX entries of everything that a model uses, each once.

    The entries are those of the paper that the package starts from, the law, its effects, the joint fit (noise before
    impact included) where the model states standard errors, and the Gaussian processes where it has any.  They are not
    those of the data.

    Raises:
        UnknownNameError: a law or an effect names a key that references.bib lacks.
    """
    return "\n\n".join(dict.fromkeys(map(_entry, _keys(model))))


def _keys(model: ContactModel | Law) -> tuple[str, ...]:
    """Keys, or whole entries, in the order of the model's parts."""
    if isinstance(model, Law):
        return (*_PAPER, *model.citations)
    keys = _PAPER if model.base is None else _keys(model.base)
    for effect in model.effects.values():
        keys += effect.citations
    if model.parameter_covariance is not None:
        keys += _JOINT_FIT
    for processes in (model.parameters, model.residual):
        if processes is not None:
            keys += _PROCESSES + (_SPARSE if isinstance(processes.gps, SparseGPs) else ())
    return keys


def _entry(key: str) -> str:
    if key.startswith("@"):
        return key
    known = _references()
    if key not in known:
        raise UnknownNameError("reference", key, known)
    return known[key]


@cache
def _references() -> dict[str, str]:
    """Entries of references.bib by key."""
    text = (files("contactlearn.models") / "references.bib").read_text(encoding="utf-8")
    entries = re.split(r"\n(?=@)", text.strip())
    return {entry.partition("{")[2].partition(",")[0]: entry.strip() for entry in entries}
