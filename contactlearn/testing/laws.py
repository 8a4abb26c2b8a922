"""Rules of every law, as tests that the package of a law of your own can inherit.

    from contactlearn.testing import LawContract
    from my_package import Frictionless

    class TestFrictionless(LawContract):
        law = Frictionless()

pytest then finds the methods: the law declares itself, stays in what a rigid contact with Coulomb friction can do
except where it says otherwise, mirrors and scales, gives the same in one batch, in blocks and in a loop, and has finite
gradients.
"""

import math
from typing import NamedTuple, Self

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn import laws
from contactlearn.laws import Law
from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.space import SPACE

N = 4000
SPEED = 2.5  # factor by which speeds and masses are scaled
ROUNDING = 1e-9  # relative to |M_c v_c|, to |v_c| and to the energy that the contact brings
REPEATED = 1e-13  # a batch and a single contact may differ in how a last digit is rounded


class Contacts(NamedTuple):
    """Random contacts and coefficients."""

    W: Float[Tensor, "n d d"]
    v_c: Float[Tensor, "n d"]
    mu: Float[Tensor, " n"]
    eps: Float[Tensor, " n"]

    @classmethod
    def draw(cls, count: int = N, seed: int = 8) -> Self:
        """Draw bodies, contact points and velocities; an eighth each has no slip, no friction, ε = 0 and ε = 1."""
        generator = torch.Generator().manual_seed(seed)

        def uniform(low: float, high: float) -> Tensor:
            return low + (high - low) * torch.rand(count, generator=generator, dtype=torch.float64)

        mass, radius = 10 ** uniform(-2, 1), 10 ** uniform(-2, 0)
        r = radius[:, None] * torch.stack((uniform(-2, 2), uniform(-2, -0.01)), -1)
        v_c = torch.stack((uniform(-5, 5), -(10 ** uniform(-1, 1))), -1)
        mu, eps = uniform(0, 1.5), uniform(0, 1)
        v_c[::8, 0], mu[1::8], eps[2::8], eps[3::8] = 0.0, 0.0, 0.0, 1.0
        return cls(rigid_body.inverse_inertia(mass, mass * radius**2, r), v_c, mu, eps)

    @classmethod
    def draw_in_space(cls, count: int = N, seed: int = 9) -> Self:
        """Draw bodies of three moments of inertia in any pose, as `draw`; |r| is at most twice √(I/m)."""
        generator = torch.Generator().manual_seed(seed)

        def uniform(low: float, high: float, *shape: int) -> Tensor:
            return low + (high - low) * torch.rand(count, *shape, generator=generator, dtype=torch.float64)

        mass, size = 10 ** uniform(-2, 1), 10 ** uniform(-2, 0)
        axes = uniform(0.4, 1, 3) * size[:, None]
        moments = mass[:, None] * (axes.square().sum(-1, keepdim=True) - axes.square())
        q = torch.cat((torch.zeros(count, 3), uniform(-1, 1, 4)), -1)
        azimuth, height = uniform(0, 2 * math.pi), uniform(0.05, 1)
        flat = (1 - height**2).sqrt()
        r = torch.stack((flat * azimuth.cos(), flat * azimuth.sin(), -height), -1) * (2 * size * uniform(0, 1))[:, None]
        slip, angle = uniform(0, 5), uniform(0, 2 * math.pi)
        v_c = torch.stack((slip * angle.cos(), slip * angle.sin(), -(10 ** uniform(-1, 1))), -1)
        mu, eps = uniform(0, 1), uniform(0, 1)
        v_c[::8, :2], mu[1::8], eps[2::8], eps[3::8] = 0.0, 0.0, 0.0, 1.0
        return cls(rigid_body.inverse_inertia(mass, rigid_body.inertia_in_world(moments, q), r), v_c, mu, eps)

    def seen_in_space(self) -> "Contacts":
        """Return planar contacts in space, where nothing couples them with the axis across the plane."""
        W = torch.zeros(len(self.mu), 3, 3, dtype=torch.float64)
        W[:, ::2, ::2], W[:, 1, 1] = self.W, 0.7 * self.W[:, 0, 0]
        v_c = torch.zeros(len(self.mu), 3, dtype=torch.float64)
        v_c[:, ::2] = self.v_c
        return Contacts(W, v_c, self.mu, self.eps)

    def part(self, which: slice) -> "Contacts":
        """Return some of the contacts."""
        return Contacts(*(values[which] for values in self))

    def size(self) -> Float[Tensor, " n"]:
        """Return |M_c v_c| in N s, the impulse that would stop the contact point."""
        return rigid_body.matvec(rigid_body.effective_inertia(self.W), self.v_c).norm(dim=-1)


class LawContract:
    """Inherit, and set `law` to an instance; its μ and ε are ignored."""

    law: Law

    def impulse(self, c: Contacts) -> Float[Tensor, "n d"]:
        """Return P in N s."""
        return self.law.at(c.mu, c.eps).impulse(c.W, c.v_c)

    def differences(self, c: Contacts | None = None) -> dict[str, bool]:
        """Return for each way in which a law may differ from a rigid contact whether this one is seen to do so."""
        c = Contacts.draw() if c is None else c
        elastic = c._replace(eps=torch.ones_like(c.eps))
        P, scale = self.impulse(c), c.size()
        v_n = (c.v_c + rigid_body.matvec(c.W, P))[:, -1]
        added = torch.cat([rigid_body.energy_excess(x.W, x.v_c, self.impulse(x)) for x in (c, elastic)])
        momentum = rigid_body.matvec(rigid_body.effective_inertia(c.W), c.v_c)
        brought = 0.5 * (c.v_c * momentum).sum(-1).repeat(2)
        return {
            "adds_energy": bool((added > ROUNDING * brought).any()),
            "leaves_cone": bool((P[:, :-1].norm(dim=-1) - c.mu * P[:, -1] > ROUNDING * scale).any()),
            "pulls": bool((P[:, -1] < -ROUNDING * scale).any()),
            "penetrates": bool((v_n < -ROUNDING * c.v_c.norm(dim=-1)).any()),
        }

    def test_it_declares_itself(self) -> None:
        """It has a docstring, and is found by its name, variant and options."""
        law = self.law
        assert type(law).__doc__, "say in the docstring what it does, and what it is not"
        assert law.name
        assert law.label
        found = laws.find(law.name, law.variant, **law.options)
        assert type(found) is type(law)
        assert (found.options, found.at(0.2, 0.5).mu) == (law.options, 0.2)

    def test_it_is_a_rigid_contact_but_for_what_it_declares(self) -> None:
        """P_n ≥ 0, |P_t| ≤ μ P_n, v_n⁺ ≥ 0 and no energy added, or a class attribute says that one does not hold."""
        assert self.impulse(Contacts.draw()).isfinite().all()
        undeclared = [name for name, seen in self.differences().items() if seen and not getattr(self.law, name)]
        assert not undeclared, f"declare {', '.join(f'{name} = True' for name in undeclared)}, or fix the law"

    def test_without_friction_there_is_no_tangential_impulse(self) -> None:
        """μ = 0 gives P_t = 0 exactly."""
        c = Contacts.draw()
        assert (self.impulse(c._replace(mu=torch.zeros_like(c.mu)))[:, 0] == 0).all()

    def test_it_mirrors_as_it_says(self) -> None:
        """The mirror image of a contact has the mirror image of its impulse."""
        c, mirror = Contacts.draw(), torch.tensor((-1.0, 1.0), dtype=torch.float64)
        image = c._replace(W=mirror[:, None] * c.W * mirror, v_c=mirror * c.v_c)
        same = self._close(self.impulse(image), mirror * self.impulse(c), c)
        assert same or not self.law.mirror_symmetric

    def test_it_scales_with_speed_as_it_says(self) -> None:
        """k times the velocity gives k times the impulse."""
        c = Contacts.draw()
        faster = c._replace(v_c=SPEED * c.v_c)
        assert self._close(self.impulse(faster), SPEED * self.impulse(c), faster) or not self.law.scales

    def test_it_scales_with_mass(self) -> None:
        """k times mass and moment of inertia give k times the impulse."""
        c = Contacts.draw()
        heavier = c._replace(W=c.W / SPEED)
        assert self._close(self.impulse(heavier), SPEED * self.impulse(c), heavier)

    def test_batched_equals_looped(self) -> None:
        """Single contacts with scalar coefficients give the same impulses."""
        c = Contacts.draw(64)
        each = zip(*c, strict=True)
        loop = torch.stack([self.law.at(mu.item(), eps.item()).impulse(W, v_c) for W, v_c, mu, eps in each])
        torch.testing.assert_close(self.impulse(c), loop, rtol=REPEATED, atol=0)

    def test_blocks_are_the_whole(self) -> None:
        """A grid of coefficients too large for one block gives the same impulses node by node."""
        c = Contacts.draw(300)
        mu, eps = (torch.linspace(0, high, count, dtype=torch.float64) for high, count in ((1.2, 17), (1.0, 19)))
        whole = self.law.at(mu[:, None, None], eps[:, None]).impulse(c.W, c.v_c)
        assert whole.shape == (17, 19, 300, 2)
        for i, j in ((0, 0), (8, 9), (16, 18)):
            node = self.law.at(mu[i], eps[j]).impulse(c.W, c.v_c)
            torch.testing.assert_close(whole[i, j], node, rtol=REPEATED, atol=0)

    def test_its_gradients_are_finite(self) -> None:
        """In W, v_c, μ and ε, also at their ends."""
        inputs = [values.clone().requires_grad_() for values in Contacts.draw()]
        P = self.impulse(Contacts(*inputs))
        for part in P.unbind(-1):
            for gradient in torch.autograd.grad(part.sum(), inputs, retain_graph=True, allow_unused=True):
                assert gradient is None or gradient.isfinite().all()

    def test_in_space_it_is_a_rigid_contact_but_for_what_it_declares(self) -> None:
        """The same rules, where the law exists in space."""
        if SPACE in self.law.spaces:
            seen = self.differences(Contacts.draw_in_space())
            undeclared = [name for name, differs in seen.items() if differs and not getattr(self.law, name)]
            assert not undeclared, f"declare {', '.join(f'{name} = True' for name in undeclared)}, or fix the law"

    def test_in_space_it_agrees_with_the_plane(self) -> None:
        """A contact of the plane has the impulse of the plane."""
        if SPACE in self.law.spaces:
            c = Contacts.draw()
            P, expected = self.impulse(c.seen_in_space()), self.impulse(c)
            assert self._close(P[:, ::2], expected, c)
            assert (P[:, 1].abs() <= ROUNDING * c.size().maximum(expected.norm(dim=-1))).all()

    def test_in_space_it_turns_with_the_contact(self) -> None:
        """A turn about the normal turns the impulse; a mirror image mirrors it, and k times the speed gives k times."""
        if SPACE not in self.law.spaces:
            return
        c = Contacts.draw_in_space()
        turn = rigid_body.rotation(torch.tensor((0.8, 0.0, 0.0, 0.6), dtype=torch.float64))
        mirror = torch.diag(torch.tensor((1.0, -1.0, 1.0), dtype=torch.float64))
        for R in (turn, *((mirror,) if self.law.mirror_symmetric else ())):
            image = c._replace(W=R @ c.W @ R.mT, v_c=c.v_c @ R.mT)
            assert self._close(self.impulse(image), self.impulse(c) @ R.mT, c)
        if self.law.scales:
            faster = c._replace(v_c=SPEED * c.v_c)
            assert self._close(self.impulse(faster), SPEED * self.impulse(c), faster)

    def test_in_space_its_gradients_are_finite(self) -> None:
        """In W, v_c, μ and ε, and batched as in a loop."""
        if SPACE not in self.law.spaces:
            return
        c = Contacts.draw_in_space(400)
        inputs = [values.clone().requires_grad_() for values in c]
        P = self.impulse(Contacts(*inputs))
        for gradient in torch.autograd.grad(P.sum(), inputs, allow_unused=True):
            assert gradient is None or gradient.isfinite().all()
        each = zip(*c.part(slice(24)), strict=True)
        loop = torch.stack([self.law.at(mu.item(), eps.item()).impulse(W, v_c) for W, v_c, mu, eps in each])
        torch.testing.assert_close(P[:24].detach(), loop, rtol=1e-9, atol=0)

    def _close(self, P: Tensor, expected: Tensor, c: Contacts) -> bool:
        error = (P - expected).norm(dim=-1) / c.size().maximum(expected.norm(dim=-1))
        return error.max().item() <= ROUNDING
