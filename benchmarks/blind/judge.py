"""The answer of a diagnosis, the ground truth of a set, and the score of the answer.

A name is right where its formula contains the hidden effect, whatever its functional form.  Names that describe a part
of the hidden physics, or that fit as well by chance, are not.  This was decided from the physics before any answer.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

from blind.load import read_suite
from contactlearn.diagnosis.result import Diagnosis

PERIOD = 0.05
"""Relative error up to which a period in trials is right."""
_SIGMAS = 2.0  # standard errors within which a parameter is right


@dataclass(frozen=True, kw_only=True)
class Answer:
    """A line of a file of answers.  Lists by effect are in the order of `effects`."""

    suite: str  # of the set
    name: str  # of the set
    verdict: str  # of the diagnosis, "failed" where it raised an error
    physics: str | None = None  # conclusion about the corrected measurements, None where they are refused
    law: str | None = None  # name of the law
    effects: list[str] = field(default_factory=list)  # names of the missing effects
    forms: list[str] = field(default_factory=list)  # names with their functional forms
    confidence: list[float] = field(default_factory=list)  # stated probabilities
    shares: list[float] = field(default_factory=list)  # shares of the plausible models that have each effect
    removed: list[float] = field(default_factory=list)  # squared errors that each effect removes, over the model's
    reducible: float = 0.0  # part of the model's squared error that something predictable makes
    unexplained: bool = False  # whether the residual shows that something unknown is missing
    trials: int = 0  # that were diagnosed
    rivals: list[list[str]] = field(default_factory=list)  # names of the confounded effects
    # names of a model with fewer effects that does nearly as well, None where there is none
    simpler: list[str] | None = None
    # names of the effects of each plausible model, None where the answer has none
    models: list[list[str]] | None = None
    corrections: list[str] = field(default_factory=list)  # names of the corrections of the measurements
    findings: list[str] = field(default_factory=list)  # names of the findings of the audit
    # symbols that the residual depends on beyond chance, by their share
    variables: list[str] = field(default_factory=list)
    # `coefficient`, `follows`, `trials` and `share` of a coefficient that follows the sequence
    serial_dependence: dict[str, Any] | None = None
    # `coefficient`, `variables` and `share` of a coefficient that depends on the state
    state_dependence: dict[str, Any] | None = None
    # names of effects that explain a part under a name that is not probable, proxies among them
    candidates: list[str] = field(default_factory=list)
    # of each listed effect, its part of the change that was planted in measured impacts; see `planted`
    planted: dict[str, dict[str, float]] = field(default_factory=dict)
    formulas: list[str] = field(default_factory=list)  # proposed for the residual
    complete: bool = True  # False where the search ran out of time
    seconds: float = 0.0  # that the diagnosis took
    error: str = ""  # message of an exception


def answer_of(suite: str, name: str, found: Diagnosis) -> Answer:
    """Write down what a diagnosis concludes."""
    remainder, missing = found.remainder, found.missing
    serial, state = (None, None) if remainder is None else (remainder.serial_dependence, remainder.state_dependence)
    learnt = sorted(remainder.variables, key=lambda one: -one.share) if remainder and remainder.predictable else []
    budget = found.budget
    return Answer(
        suite=suite,
        name=name,
        verdict=str(found.verdict),
        physics=None if found.physics is None else str(found.physics),
        law=found.law,
        effects=list(found.effects),
        forms=[str(one.effect) for one in missing],
        confidence=[one.confidence for one in missing],
        shares=[one.share for one in missing],
        removed=[] if budget is None else [budget.removed(one.error_reduction) for one in missing],
        reducible=0.0 if budget is None else budget.reducible,
        unexplained=remainder is not None and remainder.unknown,
        trials=0 if found.record is None else len(found.record.impacts),
        rivals=[[rival.effect.name for rival in one.rivals] for one in missing],
        simpler=None if found.simpler is None else [one.name for one in found.simpler.effects],
        models=[[one.name for one in model.effects] for model in found.models] if found.models else None,
        corrections=[one.correction for one in found.findings if one.mistake and one.correction],
        findings=[str(one.name) for one in found.findings],
        variables=[one.symbol for one in learnt],
        serial_dependence=None
        if serial is None
        else {
            "coefficient": None if serial.coefficient is None else str(serial.coefficient),
            "follows": str(serial.variable),
            "trials": serial.trials,
            "share": serial.share.mean,
        },
        state_dependence=None
        if state is None
        else {
            "coefficient": None if state.coefficient is None else str(state.coefficient),
            "variables": [one.symbol for one in state.variables],
            "share": state.share.mean,
        },
        candidates=[one.effect.name for one in found.candidates],
        formulas=[one.text for one in found.formulas],
        complete=found.complete,
    )


@dataclass(frozen=True, kw_only=True)
class Truth:
    """The ground truth of a set."""

    group: str  # kind of the set, in the suite's words
    # to be found out: `effects` (these and no other), `nothing`, `unknown` physics, `confounded` effects, `measurement`
    # (faults), `includes` (this effect among others), `ordered` (these first), or `unjudged`
    question: str
    n: int  # number of trials
    half: str | None = None  # see `BlindSet`
    hidden: Sequence[str] = ()  # effects in the author's words, or their functional forms
    accepted: Sequence[Sequence[str]] = ()  # right names of each known effect
    confounded: Sequence[str] = ()  # effects that the trials cannot tell from the first
    coefficient: str | None = None  # of the law that unknown physics changes, `mu` or `eps`; None for another quantity
    variables: Sequence[str] = ()  # symbols that unknown physics depends on
    follows: Sequence[str] = ()  # quantities that unknown physics follows along the sequence of the trials
    period: float | None = None  # of that in trials
    # names that describe a part of unknown physics and count as right; None where nobody judged that
    acceptable: Sequence[str] | None = None
    tolerated: Sequence[str] = ()  # names that describe a part of unknown physics and do not count
    ignored: Sequence[str] = ()  # names that do not count in this set
    bad_data: bool | None = None  # whether the measurements are faulty; None where that is a matter of taste
    corrections: Sequence[str] = ()  # of faulty measurements
    share: float | None = None  # of the law's error that all effects make; None where it was not computed
    unknown_by: str = "verdict"  # field of the answer that calls physics unknown, `physics` or `verdict`
    # fields of the answer that may list a confounded effect, beside the named ones
    confounded_in: Sequence[str] = ("rivals",)

    @property
    def right(self) -> set[str]:
        """Names that count as right."""
        return {*self.confounded, *(self.acceptable or ()), *(name for names in self.accepted for name in names)}


def read_truth(suite: str) -> dict[str, Truth]:
    """Open the ground truth of all sets of a suite."""
    known, header = {one.name for one in fields(Truth)}, read_suite(suite)
    protocol = {name: header[name] for name in ("unknown_by", "confounded_in")}
    return {
        name: Truth(**protocol, **{key: value for key, value in entry.items() if key in known})
        for name, entry in header["sets"].items()
    }


@dataclass(frozen=True, kw_only=True)
class Score:
    """Answers to the questions about a set; None where a question is not asked."""

    first: bool | None = None  # the first name is right (of measured drops, any name)
    exact: bool | None = None  # every name is a hidden effect, and none is missing
    simpler: bool | None = None  # that, or it is true of the simpler model
    # it is true of a plausible model or of the simpler one; of measured drops, a name or a candidate is
    plausible: bool | None = None
    no_false_name: bool | None = None  # no name is wrong, where nothing is hidden or something unknown is
    false_unknown: bool | None = None  # something is called unknown where nothing is
    unknown: bool | None = None  # unknown physics is called unknown
    acceptable: bool | None = None  # unknown physics is called unknown, or all names describe a part of it
    # the right coefficient of unknown physics is given, or what it follows, or one of its variables
    dependence: bool | None = None
    follows: bool | None = None  # the right coefficient is given and what it follows along the sequence
    confounded: bool | None = None  # the hidden effect and a confounded one are both listed
    bad_data: bool | None = None  # faulty measurements are called so, and sound ones are not
    # faulty measurements are corrected rightly, or not at all where nothing corrects them
    correction: bool | None = None
    parameters: bool | None = None  # those of a planted effect are the planted ones within two standard errors
    planted: bool | None = None  # a planted effect takes what it can of the planted change within two standard errors
    named: tuple[tuple[int, bool], ...] = ()  # place of each name that is judged, and whether it is right


def score(answer: Answer, truth: Truth) -> Score:
    """Compare an answer with the truth."""
    names = [name for name in answer.effects if name not in truth.ignored]
    bad_data = answer.verdict == "bad_data"
    sound = None if truth.bad_data is None else bad_data == truth.bad_data
    unknown = getattr(answer, truth.unknown_by) == "unknown"
    match truth.question:
        case "unjudged":
            return Score()
        case "includes":
            listed = [*names, *answer.candidates]
            parts = [part for name, part in answer.planted.items() if name in truth.right]
            return Score(
                first=not truth.right.isdisjoint(names),
                plausible=not truth.right.isdisjoint(listed),
                parameters=any(part["off"] <= _SIGMAS for part in parts),
                planted=any(abs(part["taken"] - part["able"]) <= _SIGMAS * part["error"] for part in parts),
            )
        case "ordered":
            right = [name in accepted for name, accepted in zip(names, truth.accepted, strict=False)]
            return Score(first=right[:1] == [True], exact=right == [True] * len(truth.accepted))
        case "measurement":
            return Score(bad_data=sound, correction=answer.corrections == truth.corrections if bad_data else None)
        case "unknown":
            return _of_unknown_physics(answer, truth, unknown, sound)
    named = tuple((k, name in truth.right) for k, name in enumerate(answer.effects) if name not in truth.ignored)
    if truth.question == "nothing":
        return Score(
            no_false_name=not names,
            plausible=_plausible(answer, truth, []),
            false_unknown=unknown,
            bad_data=sound,
            named=named,
        )
    accepted = [set(right) for right in truth.accepted]
    confounded = truth.question == "confounded"
    if confounded:
        accepted[-1] |= set(truth.confounded)
    exact = matches(names, accepted)
    return Score(
        first=bool(names) and any(names[0] in right for right in accepted),
        exact=exact,
        simpler=exact or (answer.simpler is not None and matches(answer.simpler, accepted)),
        plausible=None if confounded else _plausible(answer, truth, accepted),
        false_unknown=unknown,
        confounded=_lists_both(answer, truth) if truth.confounded else None,
        bad_data=sound,
        named=() if confounded else named,
    )


def _of_unknown_physics(answer: Answer, truth: Truth, unknown: bool, sound: bool | None) -> Score:
    names, right = answer.effects, truth.right
    coefficient, follows = _serial_dependence(answer, truth)
    described = truth.coefficient or truth.variables or truth.follows
    return Score(
        first=bool(names) and any(names[0] in accepted for accepted in truth.accepted) if truth.accepted else None,
        no_false_name=not false_names(names, truth),
        unknown=unknown,
        acceptable=None if truth.acceptable is None else unknown or (bool(names) and set(names) <= right),
        dependence=coefficient or follows or _state_dependence(answer, truth) if described else None,
        follows=coefficient and follows if truth.follows and truth.coefficient else None,
        bad_data=sound,
        named=tuple((k, name in right) for k, name in enumerate(names) if name not in truth.tolerated),
    )


def false_names(names: Iterable[str], truth: Truth) -> list[str]:
    """Names that are wrong beside unknown physics."""
    return [name for name in names if name not in truth.right and name not in truth.tolerated]


def _serial_dependence(answer: Answer, truth: Truth) -> tuple[bool, bool]:
    """Whether the coefficient that follows the sequence is right, and what it follows."""
    found = answer.serial_dependence
    if found is None or not truth.follows:
        return False, False
    follows = found["follows"] in truth.follows
    if found["follows"] == "period" and truth.period is not None:
        follows = abs(found["trials"] / truth.period - 1) < PERIOD
    return found["coefficient"] == truth.coefficient, follows


def _state_dependence(answer: Answer, truth: Truth) -> bool:
    """Whether a coefficient that depends on the state is right, or one of the first two variables."""
    found, variables = answer.state_dependence, answer.variables[:2]
    if found is not None:
        variables = [*variables, *found["variables"][:2]]
        if truth.coefficient is not None and found["coefficient"] == truth.coefficient:
            return True
    return not set(variables).isdisjoint(truth.variables)


def _plausible(answer: Answer, truth: Truth, accepted: Sequence[set[str]]) -> bool | None:
    """Whether the true set is a plausible model or the simpler one."""
    if answer.models is None:
        return None
    models = [*answer.models, *([] if answer.simpler is None else [answer.simpler])]
    return any(matches([name for name in model if name not in truth.ignored], accepted) for model in models)


def _lists_both(answer: Answer, truth: Truth) -> bool:
    """Whether the hidden effect and a confounded one are both listed."""
    listed = set(answer.effects)
    for name in truth.confounded_in:
        listed.update(*(getattr(answer, name) or ()))
    return not listed.isdisjoint(truth.accepted[0]) and not listed.isdisjoint(truth.confounded)


def matches(names: Sequence[str], accepted: Sequence[set[str]]) -> bool:
    """Whether each name is accepted for one hidden effect of its own, and none is left on either side."""
    if len(names) != len(accepted):
        return False
    return not names or any(
        names[0] in right and matches(names[1:], [*accepted[:k], *accepted[k + 1 :]])
        for k, right in enumerate(accepted)
    )
