"""The diagnosis of a large table by subsamples, in sentences: what was diagnosed, and how all its trials confirm it."""

from contactlearn.diagnosis.events import SubsampleStarted
from contactlearn.diagnosis.result import Answer, Confirmation, Diagnosis, FailingRegion, Limit, Sample
from contactlearn.report.text.names import effect_label, law_label, join_words, sentence
from contactlearn.report.text.numbers import counted, error, interval, p_value, percent, times
from contactlearn.report.text.verdict import VERDICTS

_LIMITS = {
    Limit.SIZE: "larger subsamples are not diagnosed",
    Limit.MEMORY: "the free memory is too small for a larger one",
}


def step(coming: SubsampleStarted) -> str:
    """Say which subsample comes next, and what it takes."""
    size = f"{counted(coming.trials)} of {counted(coming.table_trials)} trials"
    if coming.resumed:
        return f"{size} were already diagnosed before the run was interrupted"
    needs = f"about {coming.seconds:.0f} s and {coming.gigabytes:.1f} GB"
    return f"{size} are diagnosed next, {_evenly(coming.objects_seen, coming.objects)}: {needs}"


def summary_of(sample: Sample) -> list[str]:
    """Say what was diagnosed, whether the answer stayed, and what all trials say of it, a sentence each."""
    test = sample.confirmation
    others = f"the {counted(test.trials)} trials outside the sample"
    inside = sample.answers[-1].error
    said = [
        f"Diagnosed on {counted(sample.trials)} of {counted(sample.of)} trials "
        f"({_evenly(sample.objects_seen, sample.objects)}). {_settled(sample)}",
        f"The error of the full model over {others} is {interval(test.named)}; on the sample it is "
        f"{error(inside.mean)}, {'equal within chance' if test.agrees else 'a significant difference'}. "
        f"The law has {error(test.base.mean)} there{_noise(test)}.",
    ]
    said += [failing_region(region, sample) for region in test.regions]
    if not test.regions:
        said.append("Over all trials, no region has a significantly higher error of the full model than the rest.")
    return said + ([sentence(test.outliers.sentence)] if test.outliers is not None else [])


def failing_region(region: FailingRegion, sample: Sample) -> str:
    """Say where the full model fails among all trials, and how much of that the sample has."""
    size = f"error {times(region.ratio.mean)} that of the rest, {p_value(region.p_value)}"
    share = f"{counted(region.trials)} of all trials ({percent(region.trials / sample.of, 1)})"
    return (
        f"The full model fails in {region.where}: {size}, {share}, of which the sample has {counted(region.sampled)}; "
        "an effect that acts only there barely enters the diagnosis."
    )


def answer(one: Answer) -> str:
    """Write the answer of a subsample: law, effects and verdict."""
    names = " + ".join((law_label(one.law), *map(effect_label, one.effects)))
    return f"{names}: {VERDICTS[one.physics]}"


def support_of(found: Diagnosis) -> str:
    """Write behind a headline what was diagnosed and what the other trials say; empty for a table diagnosed whole."""
    sample = found.sample
    if sample is None:
        return ""
    named = error(sample.confirmation.named.mean)
    return (
        f"Diagnosed on {counted(sample.trials)} of {counted(sample.of)} trials; over the "
        f"{counted(sample.confirmation.trials)} others the named model has an error of {named}."
    )


def _evenly(seen: int, objects: int) -> str:
    """Over what the subsample is even."""
    bodies = "" if objects == 1 else f", all {objects} objects" if seen == objects else f", {seen} of {objects} objects"
    return f"spread evenly over the inputs{bodies} and the whole sequence"


def _settled(sample: Sample) -> str:
    """Whether the last two subsamples agree."""
    before = sample.answers[:-1]
    if sample.limit is None:
        return f"{counted(before[-1].trials)} trials gave the same law, effects and verdict."
    why = _LIMITS[sample.limit]
    if not before:
        return f"It is not known whether more trials would change the answer: {why}."
    given = join_words(f"{counted(one.trials)} trials gave {answer(one)}" for one in before)
    return f"The answer still changed with the size of the sample ({given}) and is not settled: {why}."


def _noise(test: Confirmation) -> str:
    """The noise floor behind the error of the law, and what is between it and the full model."""
    if test.noise is None:
        return ""
    left = "no" if test.noise.high >= test.named.mean else error(test.named.mean - test.noise.mean)
    return f", noise alone {error(test.noise.mean)}, which leaves {left} error"
