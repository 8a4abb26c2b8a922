"""Rules of every effect, as tests that the package of an effect of your own can inherit.

    from contactlearn.testing import EffectContract
    from my_package import SeamFriction

    class TestSeamFriction(EffectContract):
        effect = SeamFriction()

pytest then finds the methods: the effect declares itself, changes nothing at its vanishing values, acts
elsewhere, gives the same batched and looped, has exact gradients, mirrors as it says and adds energy as it says.
Each form of a family is a class and has a test class of its own.  It is tried in the plane if it exists there, and in
space by a test of its own.
"""

import math
from functools import cache

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.effects import Effect, State, columns, find_effect
from contactlearn.effects.checks import violations
from contactlearn.inference.identification.joint import assemble
from contactlearn.laws import Law
from contactlearn.laws.wang_mason import WangMason
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.mechanics.rigid_body import squared_mass_norm
from contactlearn.mechanics.shapes import Cuboid, Shape, contact_point
from contactlearn.mechanics.space import BOTH, PLANE
from contactlearn.models.contact_model import linearised, resolve
from contactlearn.simulation import synthetic

N = 400
COEFFICIENTS, ELASTIC = torch.tensor(((0.15, 0.6), (0.05, 1.0)), dtype=torch.float64)  # μ and ε
MIRROR = torch.tensor((-1.0, 1.0, -1.0), dtype=torch.float64)
MIRROR_IN_SPACE = torch.tensor((1.0, -1.0, 1.0, -1.0, 1.0, -1.0), dtype=torch.float64)
ROUNDING = 1e-10  # relative to 1 m/s and 10 rad/s: a few operations more or less
DIFFERENCES = 1e-3  # of a difference with a step of 1e-6 of the range


_COVARIATES = {"temperature": torch.linspace(10, 30, N), "operator": ("A", "B") * (N // 2)}


@cache
def _drops(shape: Shape | None) -> Impacts:
    """Make the drops of `EffectContract.impacts` once for all tests."""
    drops = synthetic.load(size=N, shape=shape, velocity_noise=0, spin_noise=0, seed=5)
    drops = drops.replace(object=tuple(("first", "second", "third")[k % 3] for k in range(N)), covariates=_COVARIATES)
    generator = torch.Generator().manual_seed(6)
    v = drops.v_pre * (0.5 + torch.rand(N, 1, generator=generator, dtype=torch.float64))
    v[::2, 0] *= -1
    v[::10] *= 0.2  # some effects act on slow impacts alone
    steep = v[:, 1] + drops.r[:, 0] * v[:, 2] < -0.1
    return drops[steep].replace(v_pre=v[steep])


@cache
def _tosses() -> Impacts:
    """Make tosses of cuboids in any pose onto a corner."""
    generator, box = torch.Generator().manual_seed(5), Cuboid((0.02, 0.03, 0.04))
    q = torch.randn(N, 7, generator=generator, dtype=torch.float64)
    q[:, 3:] /= q[:, 3:].norm(dim=-1, keepdim=True)
    r, mass = contact_point(box, q[:, 3:]), torch.full((N,), 0.1, dtype=torch.float64)
    inertia = mass[:, None] * box.gyration_squared()
    v = torch.randn(2, N, 6, generator=generator, dtype=torch.float64) * torch.tensor((1, 1, 1, 6, 6, 6))
    v[0, :, 2] -= 2
    tosses = Impacts(
        mass, inertia, r, q, v[0], v[1], shape=box, object=("first", "second") * (N // 2), covariates=_COVARIATES,
        validate=False,
    )  # fmt: skip
    return tosses[tosses.v_c[:, 2] < -0.1]


class EffectContract:
    """Inherit, and set `effect` to an instance; `law` is the law that it acts around.

    `shape` is that of the body, an ellipse if None; an effect that acts on polygons alone needs one of them.
    """

    effect: Effect
    law: Law = WangMason()
    shape: Shape | None = None

    def impacts(self) -> Impacts:
        """Drops of three equal objects from both sides and from different heights; tosses if it is of space alone."""
        return _drops(self.shape) if PLANE in self.effect.spaces else _tosses()

    def predict(
        self,
        impacts: Impacts,
        values: Float[Tensor, "*batch k"],
        coefficients: Float[Tensor, "2"] = COEFFICIENTS,
    ) -> Prediction:
        """Predict with the effect at values [..., K] of its parameters."""
        theta = torch.cat((coefficients.expand(*values.shape[:-1], 2), values), -1)
        return assemble(self.law, {"it": self.prepared}, theta).predict(impacts)

    @property
    def prepared(self) -> Effect:
        """The effect with the numbers that it takes from the data."""
        return self.effect.prepare(self.impacts())

    def samples(self, count: int = 16) -> Float[Tensor, "count k"]:
        """Draw values [count, K] spread over a third of the plausible ranges about the vanishing ones."""
        generator = torch.Generator().manual_seed(7)
        effect = self.prepared
        low, high = torch.tensor([(p.low, p.high) for p in effect.parameters], dtype=torch.float64).T
        at_rest = columns(*effect.vanished().values)
        spread = torch.rand(count, len(low), generator=generator, dtype=torch.float64)
        return at_rest + (low + spread * (high - low) - at_rest) / 3

    def test_it_declares_itself(self) -> None:
        """It has a docstring, an equation and parameters, breaks no rule, and its options make it again."""
        effect = self.prepared
        assert effect.equation
        assert effect.__doc__, "say in the docstring what it does, and what it is not"
        assert effect.parameters, "an effect has at least one parameter"
        assert not (broken := [*violations(effect, self.impacts())]), f"{effect.id} {'; '.join(broken)}"
        again = type(effect)(**effect.options).at(columns(*effect.values))
        assert again.parameters == effect.parameters
        assert find_effect(effect.name, effect.form) is type(effect), "another effect or form has the same name"

    def test_it_vanishes_to_the_last_bit(self) -> None:
        """At its vanishing values every bit of the prediction is that of the law alone."""
        impacts = self.impacts()
        found = self.predict(impacts, columns(*self.prepared.vanished().values))
        expected = assemble(self.law, {}, COEFFICIENTS).predict(impacts)
        assert torch.equal(found.v_post, expected.v_post)
        assert torch.equal(found.wrench, expected.wrench)

    def test_it_acts(self) -> None:
        """Away from its vanishing values it changes some trial."""
        impacts = self.impacts()
        at_rest = self.predict(impacts, columns(*self.prepared.vanished().values)).v_post
        assert ((self.predict(impacts, self.samples(2)).v_post - at_rest).abs().amax((-2, -1)) > 0).all()

    def test_batched_equals_looped(self) -> None:
        """Leading axes of values and a choice of trials give what one value and one trial give."""
        impacts, samples = self.impacts(), self.samples(3)
        batch = self.predict(impacts, samples)
        for k in range(3):
            one = self.predict(impacts, samples[k])
            assert torch.allclose(batch.v_post[k], one.v_post, rtol=ROUNDING, atol=ROUNDING)
            assert torch.allclose(batch.wrench[k], one.wrench, rtol=ROUNDING, atol=ROUNDING)
        some = [3, 141]
        assert torch.allclose(
            batch.v_post[:, some], self.predict(impacts[some], samples).v_post, rtol=ROUNDING, atol=ROUNDING
        )

    def test_its_gradients_are_finite_and_exact(self) -> None:
        """Where it vanishes too; against differences on the nineteen in twenty trials that keep their contact mode."""
        impacts = self.impacts()
        state, law = State.of(impacts), self.law.at(*COEFFICIENTS)
        width = torch.tensor([p.high - p.low for p in self.prepared.parameters], dtype=torch.float64)
        for values in (columns(*self.prepared.vanished().values), *self.samples(2)):
            own = [value.expand(len(impacts)) for value in values]
            _, slopes = linearised(
                lambda *own: resolve(law, {"it": self.prepared.at(own)}, state, law.mu, law.eps).v_post, own
            )
            slopes = slopes * width
            assert slopes.isfinite().all()
            for k, step in enumerate(1e-6 * torch.diag(width)):
                up, here, down = self.predict(impacts, values + torch.stack((step, 0 * step, -step))).v_post
                # At a kink, such as that of what acts on one side only, the difference on one side agrees.
                differences = torch.stack(((up - down) / 2, up - here, here - down)) * 1e6
                error = (differences - slopes[..., k]).abs().amax(-1).amin(0)
                assert (error <= DIFFERENCES * (1 + slopes[..., k].abs().amax(-1))).double().mean() > 0.95

    def test_it_mirrors_as_it_says(self) -> None:
        """If `mirror_symmetric`, the mirror image of an impact has the mirror image of the outcome."""
        impacts, samples = self.impacts(), self.samples(8)
        d, mirror = impacts.space.d, MIRROR if impacts.space is PLANE else MIRROR_IN_SPACE
        turn = mirror[d:] if impacts.space is PLANE else torch.tensor((1.0, -1.0, 1.0, -1.0), dtype=torch.float64)
        q = impacts.q * torch.cat((mirror[:d], turn))
        mirrored = impacts.replace(q=q, r=impacts.r * mirror[:d], v_pre=impacts.v_pre * mirror)
        difference = self.predict(mirrored, samples).v_post * mirror - self.predict(impacts, samples).v_post
        difference = difference.abs().max().item()
        assert difference < 1e-8 or not self.effect.mirror_symmetric, f"the mirror image differs by {difference:.3g}"

    def test_it_adds_energy_only_if_it_says_so(self) -> None:
        """Around an elastic contact with little friction."""
        impacts, samples = self.impacts(), self.samples(64)
        body = impacts.mass, impacts.world_inertia
        after = squared_mass_norm(*body, self.predict(impacts, samples, ELASTIC).v_post)
        before = squared_mass_norm(*body, impacts.v_pre)
        gained = ((after - before) / before).max().item()
        assert math.isfinite(gained)
        assert (gained > ROUNDING) <= self.effect.adds_energy, f"a share {gained:.3g} of the energy is added"

    def test_in_space_it_keeps_these_rules(self) -> None:
        """It vanishes, is the same in a batch and has finite gradients, if it exists in the plane and in space."""
        if self.effect.spaces != BOTH:
            return
        impacts = _tosses()
        effect, law = self.effect.prepare(impacts), self.law.at(*COEFFICIENTS)
        assert not (broken := [*violations(effect, impacts)]), f"{effect.id} {'; '.join(broken)}"
        at_rest = columns(*effect.vanished().values)
        width = torch.tensor([p.high - p.low for p in effect.parameters], dtype=torch.float64)
        values = torch.stack((at_rest, at_rest + 0.1 * width))
        own = [value.expand(len(impacts)) for value in values[1]]
        outcome, slopes = linearised(
            lambda *own: resolve(law, {"it": effect.at(own)}, State.of(impacts), law.mu, law.eps).v_post, own
        )
        assert slopes.isfinite().all()
        theta = torch.cat((COEFFICIENTS.expand(2, 2), values), -1)
        batch = assemble(self.law, {"it": effect}, theta).predict(impacts).v_post
        assert torch.allclose(batch[1], outcome, rtol=ROUNDING, atol=ROUNDING)
        vanished = assemble(self.law, {"it": effect}, theta[0]).predict(impacts).v_post
        assert torch.equal(vanished, assemble(self.law, {}, COEFFICIENTS).predict(impacts).v_post)
