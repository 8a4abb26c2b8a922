"""Columns of measurements under many hypotheses at once: `Impacts` with an axis of hypotheses before the trials.

`Impacts` are validated whenever they are made; thousands of hypotheses about units and axes are compared on these.
"""

from dataclasses import dataclass, replace
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from contactlearn.mechanics.bodies import AnyShape
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import contact_velocity

_FIELDS = ("mass", "inertia", "r", "q", "v_pre", "v_post", "q_post")


@dataclass(frozen=True, kw_only=True)
class Columns:
    """Fields of `Impacts` in their units, [..., n] and [..., n, 2 or 3]; nothing is validated."""

    mass: Float[Tensor, "*batch n"]
    inertia: Float[Tensor, "*batch n"]
    r: Float[Tensor, "*batch n 2"]
    q: Float[Tensor, "*batch n 3"]
    v_pre: Float[Tensor, "*batch n 3"]
    v_post: Float[Tensor, "*batch n 3"]
    q_post: Float[Tensor, "*batch n 3"] | None
    shape: AnyShape | None
    body: Int[Tensor, " n"]

    @classmethod
    def of(cls, impacts: Impacts) -> "Columns":
        """Return the columns of impacts as those of one hypothesis, [1, n]."""
        there = (name for name in _FIELDS if getattr(impacts, name) is not None)
        fields: dict[str, Any] = {"q_post": None} | {name: getattr(impacts, name)[None] for name in there}
        return cls(**fields, shape=impacts.shape, body=impacts.body)

    @property
    def v_c(self) -> Float[Tensor, "*batch n 2"]:
        """Velocity (v_t, v_n) of the contact point before contact in m/s."""
        return contact_velocity(self.r, self.v_pre)

    def replace(self, **changes: Tensor) -> "Columns":
        """Return the columns with some of them changed."""
        return replace(self, **changes)

    def __getitem__(self, which: Tensor) -> "Columns":
        """Return the hypotheses at these places of the first axis."""
        fields = {name: x[which] for name in _FIELDS if (x := getattr(self, name)) is not None}
        return replace(self, **fields)

    def and_also(self, others: "Columns") -> "Columns":
        """Return the hypotheses of both, these first."""
        pairs = {name: (getattr(self, name), getattr(others, name)) for name in _FIELDS}
        return replace(self, **{name: torch.cat(pair) for name, pair in pairs.items() if pair[0] is not None})
