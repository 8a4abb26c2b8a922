"""The search in sentences: error against number of effects, and models that the data cannot tell apart."""

from collections.abc import Sequence

from contactlearn.diagnosis.result import Diagnosis, FrontierModel, PlausibleModel
from contactlearn.effects import EffectId
from contactlearn.report.text.names import effect_label, law_label, listed
from contactlearn.report.text.numbers import compared, error, percent, share_of_whole
from contactlearn.report.text.verdict import confidence

_SHOWN = 5
_LEAST = 0.01  # of all belief, below which a model is not listed

_STOPPED = "The search ran out of time; better models may exist among those that it did not reach."


def model_name(law: str, effects: Sequence[EffectId]) -> str:
    """Name a model by its law and effects."""
    return " + ".join((law_label(law), *map(effect_label, effects)))


def share(model: PlausibleModel) -> str:
    """Write the share of a model in percent; a share that rounds to all of it is not all of it if others exist."""
    return share_of_whole(model.share)


def listed_models(found: Diagnosis) -> tuple[PlausibleModel, ...]:
    """Return the models that are worth a line: the chosen one, and then the likeliest others."""
    chosen = [model for model in found.models if _is_chosen(found, model)]
    others = [model for model in found.models if model not in chosen and model.share >= _LEAST]
    return (*chosen, *others[: _SHOWN - len(chosen)])


def listed_name(found: Diagnosis, model: PlausibleModel) -> str:
    """Name a model of the list, and say which is the chosen one where there are others."""
    name = model_name(model.law, model.effects)
    return f"{name} (chosen)" if len(found.models) > 1 and _is_chosen(found, model) else name


def _is_chosen(found: Diagnosis, model: PlausibleModel) -> bool:
    """Whether a model is that of the verdict, which need not have the largest share of belief."""
    return model.law == found.law and {*model.effects} == {one.effect for one in found.missing}


def equal_laws(found: Diagnosis) -> str:
    """Say which other laws do as well with the same effects; empty where none does."""
    belief: dict[str, float] = {}
    for model in found.models:
        belief[model.law] = belief.get(model.law, 0.0) + model.share
    others = [name for name, x in belief.items() if name != found.law and x >= _LEAST]
    if not others or found.law is None:
        return ""
    names = listed(f"{law_label(name)} ({percent(belief[name])})" for name in sorted(others, key=lambda x: -belief[x]))
    return f"These data cannot distinguish {law_label(found.law)} ({percent(belief[found.law])}) from {names}."


def confidences(found: Diagnosis) -> str:
    """Say how probable it is that each name is right; empty where nothing is named."""
    if not found.missing:
        return ""
    names = listed(f"{effect_label(one.effect)} {confidence(one)}" for one in found.missing)
    return f"The probability that each name is correct, calibrated on planted effects: {names}."


def stand_ins(found: Diagnosis) -> str:
    """Say why a larger model was not chosen that has effects for a part each of what is unknown; empty where none."""
    left = found.remainder
    if left is None or left.state_dependence is None or not left.state_dependence.superseded_effects:
        return ""
    names = listed(map(effect_label, left.state_dependence.superseded_effects))
    return (
        "Once a Gaussian process learns the unmodelled part, no larger model predicts clearly better: "
        f"{names} would only be a proxy for it."
    )


def unwanted(found: Diagnosis) -> str:
    """Name the candidates of one's own that the data do not ask for; empty where there are none."""
    return f"Tested, not selected: {listed(map(effect_label, found.unwanted))}." if found.unwanted else ""


def simpler(found: Diagnosis) -> str:
    """Say which model with fewer effects does nearly as well; empty where none does."""
    model = found.simpler
    if model is None or found.budget is None:
        return ""
    kept = {effect.name for effect in model.effects}
    lacking = [effect_label(one.effect) for one in found.missing if one.effect.name not in kept]
    said = f"{model_name(model.law, model.effects)} has {compared(model.error.mean, found.budget.named.mean)} error"
    if not lacking:
        return f"{said}."
    if not model.effects:
        return f"{said}: {listed(lacking)} {'contributes' if len(lacking) == 1 else 'contribute'} little."
    return f"{said}: {listed(lacking)} may only compensate for imperfect functional forms of the others."


def notes(found: Diagnosis) -> list[str]:
    """List what else is to be said of the search."""
    said = (confidences, stand_ins, unwanted, simpler, equal_laws)
    found_out = [*(say(found) for say in said), "" if found.complete else _STOPPED]
    return [note for note in found_out if note]


def frontier_line(model: FrontierModel) -> str:
    """Write a model of the frontier with its error."""
    return f"{error(model.error.mean)}  {interval_of(model)}  {model_name(model.law, model.effects)}"


def interval_of(model: FrontierModel) -> str:
    """Write the 95 % interval of the error of a model of the frontier."""
    return f"{error(model.error.low)}–{error(model.error.high)}"
