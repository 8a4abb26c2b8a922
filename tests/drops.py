"""Drops for tests of fits: of varying coefficients with the law fitted to them, published and mirrored ones."""

import torch

from contactlearn import laws
from contactlearn.inference.identification import joint
from contactlearn.models.contact_model import predict_with
from contactlearn.simulation import synthetic

LAW = laws.find("wang_mason").at(0.25, 0.55)
NOISE = torch.tensor([0.02, 0.02, 0.6], dtype=torch.float64)


def seeded(seed=0):
    return torch.Generator().manual_seed(seed)


def normal(*shape, seed):
    return torch.randn(*shape, generator=seeded(seed), dtype=torch.float64)


def rough(n, seed):
    """Heavy tails and a scatter that differs from trial to trial."""
    tails = normal(n, 4, seed=seed + 3).square().mean(-1, keepdim=True).sqrt()
    return normal(n, 3, seed=seed + 4) / tails * (0.5 * normal(n, 1, seed=seed + 5)).exp()


def thrown(n, seed):
    """Bodies thrown to both sides at many speeds, without outcomes."""
    drops = synthetic.load(n, seed=seed, velocity_noise=0.0, spin_noise=0.0)
    speeds = torch.rand(n, 2, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    side = normal(n, seed=seed + 1).sign()
    v_pre = torch.stack((side * (0.3 + 2 * speeds[:, 0]), -0.8 - 2 * speeds[:, 1], drops.v_pre[:, 2] / 2), -1)
    drops = drops.replace(v_pre=v_pre, validate=False)
    drops = drops[drops.v_c[:, 1] < -0.2]
    return drops.replace(order=torch.arange(1, len(drops) + 1), validate=True)


def fitted(n, seed, friction=None, restitution=None, errors=None):
    """Drops whose coefficients change by functions of the drops, and the law fitted to them."""
    drops = thrown(n, seed)
    values = torch.stack([x.expand(len(drops)) for x in LAW.coefficients], -1).clone()
    for k, change in enumerate((friction, restitution)):
        if change is not None:
            values[:, k] += change(drops)
    noise = normal(len(drops), 3, seed=seed + 2) if errors is None else errors(len(drops), seed)
    drops = drops.replace(v_post=predict_with(LAW, drops, values).v_post + NOISE * noise)
    return drops, joint.fit(drops, LAW)


def drops_of(source, n, law, variant, request, order, **noise):
    """n drops of each kind that a law may meet: its own with noise, the published, those with x mirrored."""
    if source == "synthetic":
        return synthetic.load(n, law, 0.15, 0.5, variant=variant, **noise)
    drops = request.getfixturevalue("ellipse_drops")
    drops = drops[torch.randperm(len(drops), generator=seeded(order))[:n]]
    if source == "published":
        return drops
    flip = torch.tensor((-1.0, 1.0, 1.0), dtype=torch.float64)  # docs/log.md: r as published, velocities mirrored
    return drops.replace(q=drops.q * flip, v_pre=drops.v_pre * flip, v_post=drops.v_post * flip)
