"""Regressor: Gaussian processes from a feature space of impacts to any quantity of theirs."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.mechanics.features import Features, feature_units
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.space import PLANE
from contactlearn.models.process_options import ProcessOptions
from contactlearn.models.standardisation import Standardisation

if TYPE_CHECKING:  # GPyTorch takes long to load
    from contactlearn.models.gp.exact import ExactGPs, Fit
    from contactlearn.models.gp.sparse import SparseGPs

EXACT_LIMIT = 2000
"""Training trials beyond which the processes are sparse."""


@dataclass(frozen=True)
class Regressor:
    """Processes for each training subset (leading axes) and each of O outputs; see `Regressor.fit`."""

    space: str
    inputs: Standardisation  # [..., 1, D]
    outputs: Standardisation  # [..., 1, O]
    gps: "ExactGPs | SparseGPs"
    status: "Fit | None" = None

    @classmethod
    def fit(
        cls,
        space: str,
        impacts: Impacts,
        rows: Int[Tensor, "*batch n"],
        values: Float[Tensor, "*batch n o"],
        *,
        weight: Float[Tensor, "*batch n o"] | None = None,
        outputs: Standardisation | None = None,
        like: "Regressor | None" = None,
        noise: Float[Tensor, "*batch n o"] | None = None,
        options: ProcessOptions = ProcessOptions(),
        on_round: "Callable[[Regressor], None] | None" = None,
    ) -> "Regressor":
        """Train on subsets of equal size.

        Args:
            space: a feature space of `contactlearn.mechanics.features`.
            impacts, rows: the subsets [..., n] as rows of the impacts; at least two trials each.
            values: what to learn [..., n, O].
            weight: w [..., n, O] > 0; the noise variance of a value is σ²/w².  1 if left out.
            outputs: standardisation of the values; from the values if left out.
            like: a regressor to begin the training from, of the same shape.
            noise: variances [..., n, O] of the values, for a likelihood that has them fixed.
            options: modules of the processes and their training.
            on_round: receives the regressor after each round of the training, whose hyperparameters go on changing.

        Raises:
            DataError: fewer than two trials, or no noise for a likelihood that has it fixed.
            UnknownNameError: no such space.
            ContactLearnError: options that do not fit the space.
        """
        from contactlearn.models.gp.exact import ExactGPs, checked_options
        from contactlearn.models.gp.sparse import SparseGPs

        if rows.shape[-1] < 2:
            raise DataError(f"a learned model needs at least 2 training trials, got {rows.shape[-1]}")
        x = Features.of(impacts, space).values[rows]
        inputs, outputs = Standardisation.of(x), outputs or Standardisation.of(values)
        family = ExactGPs if rows.shape[-1] <= EXACT_LIMIT else SparseGPs
        noise = None if noise is None else noise / outputs.scale**2
        options = checked_options(options, list(feature_units(space, impacts.space)))
        weight, noise = (None if part is None else part.mT for part in (weight, noise))
        gps = family(inputs.apply(x), outputs.apply(values).mT, weight, options, noise)
        untrained = cls(space, inputs, outputs, gps)
        report = None if on_round is None else lambda status: on_round(replace(untrained, status=status))
        try:
            return replace(untrained, status=gps.fit(like and like.gps, on_round=report))
        except (RuntimeError, ValueError) as error:
            if isinstance(error, ContactLearnError) or not str(options):  # not of a module that a user chose
                raise
            seen = " ".join(str(error).split())
            raise ContactLearnError(f"processes{options} cannot be trained: {seen}") from error

    @property
    def training(self) -> "Fit":
        """Result of the search for the hyperparameters.

        Raises:
            ContactLearnError: the processes come from a checkpoint, which does not keep it.
        """
        if self.status is None:
            raise ContactLearnError("how the processes were trained is known only where they were; learn them again")
        return self.status

    @property
    def objective(self) -> str:
        """What the training maximised: the posterior of the hyperparameters, or the marginal likelihood."""
        return "posterior" if self.gps.options.prior else "marginal likelihood"

    @property
    def kind(self) -> str:
        """Exact processes, or sparse ones and why; and how they are trained, with modules that are not the default."""
        from contactlearn.models.gp.exact import ExactGPs

        gap = None if self.status is None else self.status.gap
        end = "" if gap is None else f", {gap.max().item():.2g} nats a trial short of an optimum"
        if isinstance(self.gps, ExactGPs):
            path = "closed form" if self.gps.has_closed_form else "GPyTorch"
            return f"exact{self.gps.options}; {self.objective} maximised by {path}{end}"
        points = self.gps.covar_module.inducing_points.shape[-2]
        why = f"since there are more than {EXACT_LIMIT} training trials"
        return (
            f"sparse ({points} inducing points){self.gps.options}, {why}; {self.objective} maximised by GPyTorch{end}"
        )

    def predict(self, impacts: Impacts) -> tuple[Float[Tensor, "*batch n o"], Float[Tensor, "*batch n o"]]:
        """Mean and variance [..., N, O], without the noise of a measurement, in the values' units."""
        mean, variance = self.gps.predict(self._inputs(impacts))
        return self.outputs.undo(mean.mT), self.outputs.spread**2 * variance.mT

    def _inputs(self, impacts: Impacts) -> Float[Tensor, "*batch n d"]:
        """Standardised features of impacts in the space of the training."""
        x = Features.of(impacts, self.space).values
        if (size := self.inputs.mean.shape[-1]) != x.shape[-1]:
            here, there = ("a plane", "space") if impacts.space is PLANE else ("space", "a plane")
            raise ContactLearnError(
                f"the model has learnt from {size} features of bodies in {there}; these bodies move in {here}"
            )
        return self.inputs.apply(x)

    def trained_with(self, impacts: Impacts) -> Bool[Tensor, " n"]:
        """Find the impacts [N] whose features are, to rounding, those of a training trial."""
        x = self._inputs(impacts)
        here, there = ((1e9 * part).round().tolist() for part in (x, self.gps.train_inputs[0][..., 0, :, :]))
        known = set(map(tuple, there))
        return torch.tensor([tuple(row) in known for row in here])

    def leave_one_out(self) -> tuple[Float[Tensor, "*batch n o"], Float[Tensor, "*batch n o"]]:
        """Value − prediction of each training trial if it were left out, and its variance, [..., n, O] each."""
        error, variance = self.gps.leave_one_out()
        return self.outputs.spread * error.mT, self.outputs.spread**2 * variance.mT
