"""Quadratic approximation of a model's loss in its own parameters and in those of every candidate effect at once.

At the vanishing values a candidate changes nothing, so one linearisation of the model with all candidates around it
gives residual e and slopes J_g of every group g of parameters: those of the law and given effects, of each effect in
the model, and of each candidate.  To first order the model with a set S of effects leaves e + Σ J_g δ_g, where the
steps of S are free, and those of an effect of the model that is not in S take it to its vanishing values.  With the
trials' robust weights, the profile likelihood over the steps and the scatter is

    loss(S) = n/2 log det (E(S)ᵀ diag(w) E(S) / n)

and needs sums of products alone, so thousands of sets cost as much as one fit.  A parameter that is undefined where
its effect vanishes, such as the place of a spot, is tried at several values, each a group of its own.
Sources: Miller 2002, for subsets of a linear model; Davies 1977, for such parameters.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.effects import Effect, EffectId, columns
from contactlearn.inference.identification.joint import Fit, FitOptions, linearise, named_parameters
from contactlearn.inference.identification.problem import suited
from contactlearn.laws import Law
from contactlearn.mechanics.impacts import Impacts

_PLACES = 6  # values of parameters that are undefined where the effect vanishes
_PRIOR = 1e-2  # of a step of a whole range: far weaker than any data, and keeps what nothing depends on still


class Group(NamedTuple):
    """Parameters of one effect, tried from one place; None for those that every model has."""

    effect: EffectId | None
    place: int = 0


@dataclass(frozen=True, kw_only=True)
class Quadratic:
    """The approximation about a fitted model.

    Args:
        groups: their columns, the ones of all models first.
        products: weighted sums of products of the columns and, last, of the residual, for each pair of components.
        theta: values of all columns.
        vanished: where a group changes nothing.
        low: bounds of the values.
        high: likewise.
        trials: number of them.
        present: groups of the effects that are in the model beside the given ones.
    """

    groups: Mapping[Group, Sequence[int]]
    products: Float[Tensor, "D D p p"]
    theta: Float[Tensor, " q"]
    vanished: Float[Tensor, " q"]
    low: Float[Tensor, " q"]
    high: Float[Tensor, " q"]
    trials: int
    present: frozenset[Group]

    @classmethod
    def about(
        cls,
        law: Law,
        effects: Mapping[str, Effect],
        fit: Fit,
        impacts: Impacts,
        *,
        given: Sequence[str],
        candidates: Mapping[Group, Effect],
        options: FitOptions,
    ) -> "Quadratic":
        """Linearise a fitted model with all candidates around it.

        Args:
            law: of the model.
            effects: of the model, by name, prepared.
            fit: to the impacts.
            impacts: measurements.
            given: names of the effects that are in every model.
            candidates: where they vanish, see `vanishing`; those of the model's own identities are left out.
            options: of the fit.
        """
        identities = {EffectId(name, effect.form) for name, effect in effects.items()}
        added = {group: effect for group, effect in candidates.items() if group.effect not in identities}
        further = {f"{group.effect}/{group.place}": effect for group, effect in added.items()}
        start = [columns(*effect.values) for effect in added.values()]
        theta = torch.cat((fit.values, *start))
        about = linearise(law, effects, impacts, theta, fit.scatter, vanishing=further, options=options)
        slope = about.slope.nan_to_num(0.0, 0.0, 0.0)
        whole = torch.cat((slope, about.residual[..., None]), -1)
        products = torch.einsum("n,nip,njq->ijpq", about.weight, whole, whole)
        parameters = named_parameters({**effects, **further}, options.box, impacts)
        groups: dict[Group, list[int]] = {Group(None): [0, 1]}
        at = 2
        for name, effect in effects.items():
            key = Group(None) if name in given else Group(EffectId(name, effect.form))
            groups.setdefault(key, []).extend(range(at, at + len(effect.parameters)))
            at += len(effect.parameters)
        for group, effect in added.items():
            groups[group] = list(range(at, at + len(effect.parameters)))
            at += len(effect.parameters)
        at_rest = (columns(*effect.vanished().values) for effect in effects.values())
        vanished = torch.cat((fit.values[:2], *at_rest, *start))
        low, high = torch.tensor([(p.low, p.high) for p in parameters], dtype=torch.float64).T
        present = frozenset(group for group in groups if group.effect in identities)
        return cls(
            groups=groups, products=products, theta=theta, vanished=vanished, low=low, high=high,
            trials=len(impacts), present=present,
        )  # fmt: skip

    def losses(self, sets: Sequence[frozenset[Group]]) -> tuple[Float[Tensor, " s"], Float[Tensor, "s q"]]:
        """Compute the loss of each set in nats over all trials, up to one constant, and the parameters that it has.

        Args:
            sets: of groups beside those that every model has.
        """
        size, q = len(sets), len(self.theta)
        step = torch.zeros(size, q + 1, dtype=torch.float64)
        step[:, -1] = 1.0
        picked = [[*self.groups[Group(None)], *(k for group in groups for k in self.groups[group])] for groups in sets]
        for row, groups in enumerate(sets):
            for group in self.present - groups:
                indices = self.groups[group]
                step[row, indices] = (self.vanished - self.theta)[indices]
        most = max(map(len, picked))
        index = torch.tensor([[*columns, *[q] * (most - len(columns))] for columns in picked])  # q stands for nothing
        free = index < q
        total = torch.einsum("iipq->pq", self.products)
        width = self.high - self.low
        total = total + torch.diag(torch.cat((_PRIOR / width.square(), width.new_zeros(1))))
        right = -(step @ total).gather(1, index) * free
        gram = total[index[:, :, None], index[:, None, :]] * free[:, :, None] * free[:, None, :]
        gram = gram + torch.diag_embed((~free).double())
        scale = gram.diagonal(dim1=-2, dim2=-1).clamp_min(1e-300).rsqrt()
        gram = gram * scale[:, :, None] * scale[:, None, :] + 1e-10 * torch.eye(most, dtype=torch.float64)
        solved = scale * torch.linalg.solve(gram, (scale * right)[..., None])[..., 0]
        step.scatter_add_(1, index, solved * free)
        step[:, :q] = (self.theta + step[:, :q]).clamp(self.low, self.high) - self.theta
        scatter = torch.einsum("ijpq,sp,sq->sij", self.products, step, step) / self.trials
        floor = 1e-12 * (1 + torch.einsum("iipq->pq", self.products)[-1, -1] / self.trials)
        loss = self.trials / 2 * torch.logdet(scatter + floor * torch.eye(len(scatter[0]), dtype=torch.float64))
        return loss, self.theta + step[:, :q]

    def values(self, groups: frozenset[Group], theta: Float[Tensor, " q"]) -> dict[EffectId, Float[Tensor, " k"]]:
        """Split the values of a set by effect."""
        return {group.effect: theta[list(self.groups[group])] for group in groups if group.effect is not None}


def vanishing(candidates: Mapping[EffectId, Effect], impacts: Impacts) -> dict[Group, Effect]:
    """Return each candidate, but for those that only refine, at the values where it vanishes."""
    return {
        Group(key, place): effect.at(point)
        for key, effect in candidates.items()
        if not effect.refines
        for place, point in enumerate(_vanishing_points(effect, impacts))
    }


def _vanishing_points(effect: Effect, impacts: Impacts) -> Float[Tensor, "p k"]:
    """Values at which an effect vanishes: one point, or several of the parameters that are undefined there."""
    parameters = suited(effect.parameters, impacts)
    free = [k for k, p in enumerate(parameters) if p.vanishing is None]
    vanished = torch.tensor([p.start if p.vanishing is None else p.vanishing for p in parameters], dtype=torch.float64)
    if not free:
        return vanished[None]
    low, high = torch.tensor([(p.low, p.high) for p in parameters], dtype=torch.float64)[free].T
    places = torch.quasirandom.SobolEngine(len(free), scramble=True, seed=0).draw(_PLACES - 1, dtype=torch.float64)
    points = vanished.repeat(_PLACES, 1)
    points[1:, free] = low + places * (high - low)
    return points
