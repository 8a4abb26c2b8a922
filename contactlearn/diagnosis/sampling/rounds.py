"""The subsamples of a large table: each is diagnosed, twice as large as the one before, until two answers agree."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from jaxtyping import Int
from torch import Tensor

from contactlearn.data.audit.corrections import correct
from contactlearn.diagnosis.events import SampleConfirmed, SubsampleStarted
from contactlearn.diagnosis.result import Answer, Diagnosis, Limit, Sample
from contactlearn.diagnosis.sampling.confirmation import confirm
from contactlearn.diagnosis.sampling.draw import object_numbers, space_filling
from contactlearn.diagnosis.sampling.kept import keep, read_kept
from contactlearn.diagnosis.stages import Study
from contactlearn.mechanics.impacts import Impacts

_BYTES, _BYTES_A_TRIAL = 0.3e9, 1.7e5  # of a diagnosis, measured: benchmarks/large_diagnoses.py
_SECONDS, _SECONDS_A_TRIAL = 13.0, 3e-3  # likewise, of one core; of later ones the first says how fast it is
_LEAST = 250  # trials of a subsample, whatever the memory
_OUTSIDE = 0.2  # share of the trials that is in no subsample, at least


@dataclass(frozen=True)
class Rounds:
    """The question about a large table.

    Args:
        study: the question about any trials, and the memory that its answer may take.
        seed: of the first generator.
        corrected: corrections of the table that were made before.
        diagnosed: answers a question about some impacts.
    """

    study: Study
    seed: int
    corrected: tuple[str, ...]
    diagnosed: Callable[[Study, Impacts], Diagnosis]

    def whole(self, trials: int) -> bool:
        """Whether so many trials are diagnosed at once."""
        return trials <= self.study.thresholds.sample.whole and self._affordable(trials)

    def run(self, impacts: Impacts) -> Diagnosis:
        """Diagnose subsamples until two answers agree, and test the last one on all trials."""
        sizes, limit = self._sizes(len(impacts))
        answers, found, rows, speed = list[Answer](), None, torch.empty(0), 1.0
        objects = object_numbers(impacts)
        for k, size in enumerate(sizes):
            generator = torch.Generator().manual_seed(self.seed + k)
            rows = space_filling(impacts, size, generator)
            found = read_kept(self.study.kept, size) if self.study.kept is not None else None
            self.study.on_event(self._started(objects, rows, speed, resumed=found is not None))
            if found is None:
                began = time.monotonic()
                found = self.diagnosed(replace(self.study, generator=generator), impacts[rows])
                speed = (time.monotonic() - began) / _seconds(size)
                if self.study.kept is not None:
                    keep(self.study.kept, found, size)
            answers.append(_answer(found, size))
            if len(answers) > 1 and answers[-1].agrees(answers[-2]):
                limit = None
                break
        assert found is not None
        return self._confirmed(found, impacts, rows, tuple(answers), limit)

    def _sizes(self, trials: int) -> tuple[list[int], Limit]:
        """Sizes of the subsamples, and what stops them in the end."""
        limits, most = self.study.thresholds.sample, int((1 - _OUTSIDE) * trials)
        first = min(limits.first, most)
        while first > _LEAST and not self._affordable(first):
            first = max(_LEAST, first // 2)
        sizes = [first]
        while 2 * sizes[-1] <= min(limits.most, most):
            if not self._affordable(2 * sizes[-1]):
                return sizes, Limit.MEMORY
            sizes.append(2 * sizes[-1])
        return sizes, Limit.SIZE

    def _affordable(self, trials: int) -> bool:
        return self.study.memory is None or _bytes(trials) <= self.study.memory

    def _started(
        self, objects: Int[Tensor, " n"], rows: Int[Tensor, " k"], speed: float, *, resumed: bool
    ) -> SubsampleStarted:
        """Describe the next subsample, and estimate its time and memory."""
        size = len(rows)
        return SubsampleStarted(
            trials=size,
            table_trials=len(objects),
            objects=int(objects.max()) + 1,
            objects_seen=len(objects[rows].unique()),
            seconds=speed * _seconds(size),
            gigabytes=1e-9 * _bytes(size),
            resumed=resumed,
        )

    def _confirmed(
        self,
        found: Diagnosis,
        impacts: Impacts,
        rows: Int[Tensor, " k"],
        answers: tuple[Answer, ...],
        limit: Limit | None,
    ) -> Diagnosis:
        """The diagnosis of the last subsample with its test on all trials, of which the outliers are then."""
        assert found.record is not None
        averaged = found.corrections[len(self.corrected) :]
        objects = object_numbers(impacts)
        confirmation = confirm(
            found,
            found.record,
            correct(impacts, averaged),
            rows,
            generator=torch.Generator().manual_seed(self.seed),
            noise=self.study.options.noise,
            thresholds=self.study.thresholds,
        )
        sample = Sample(
            of=len(impacts),
            objects=int(objects.max()) + 1,
            objects_seen=len(objects[rows].unique()),
            answers=answers,
            limit=limit,
            confirmation=confirmation,
        )
        self.study.on_event(SampleConfirmed(sample=sample))
        findings = [one for one in found.findings if one.name != "model_outliers"]
        findings += [confirmation.outliers] if confirmation.outliers is not None else []
        return replace(found, findings=tuple(findings), sample=sample)


def _bytes(trials: int) -> float:
    """Memory that a diagnosis of so many trials takes."""
    return _BYTES + _BYTES_A_TRIAL * trials


def _seconds(trials: int) -> float:
    """Time that it takes, s."""
    return _SECONDS + _SECONDS_A_TRIAL * trials


def _answer(found: Diagnosis, trials: int) -> Answer:
    """The answer of a subsample."""
    assert found.law is not None
    assert found.physics is not None
    assert found.budget is not None
    effects = tuple(missing.effect for missing in found.missing)
    return Answer(trials=trials, law=found.law, effects=effects, physics=found.physics, error=found.budget.named)
