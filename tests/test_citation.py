"""`cite` names the sources of everything that a model uses, and of nothing else."""

import re
from dataclasses import dataclass

import pytest
import torch

from contactlearn import ContactModel, cite, laws
from contactlearn.core.errors import UnknownNameError
from contactlearn.effects import catalogue, find_effect
from contactlearn.inference.identification import joint
from contactlearn.inference.learning.recipe import Recipe, learn
from contactlearn.laws import Law
from contactlearn.models.citation import _references
from contactlearn.simulation import synthetic


def _keys(text):
    return re.findall(r"@\w+\{(\w+),", text)


def test_a_law_cites_the_paper_and_itself():
    assert _keys(cite(laws.find("mirtich"))) == ["fazeli2017", "mirtich1996", "stronge1990"]
    assert cite(ContactModel(laws.find("mirtich"))) == cite(laws.find("mirtich"))
    drops = synthetic.load(size=40)
    law = laws.find("whittaker").at(0.1, 0.5)
    model = learn(drops, Recipe("x1", "impulse", law), rows=torch.arange(30), base=law)
    assert _keys(cite(model)) == ["fazeli2017", "whittaker1944", "rasmussen2006", "gardner2018"]
    drops = synthetic.load(size=60)
    effects = {"drag": find_effect("side_drag")(), "soft": find_effect("velocity_dependent_restitution")()}
    model = joint.fit(drops, laws.find("wang_mason"), effects).model
    fit = ["lange1989", "mackinnon1985", "boggs1987", "fuller1987", "carroll2006"]
    assert _keys(cite(model)) == ["fazeli2017", "wang1992", "johnson1985", "kuwabara1987", *fit]


def test_an_own_law_cites_its_entry_or_names_the_missing_key():
    @dataclass(frozen=True)
    class Mine(Law):
        citations = ("@misc{mine2026,\n  title = {Mine}\n}",)

        def solve(self, contact, mu, eps):
            return 0 * contact.v_n, -(1 + eps) * contact.v_n / contact.w_nn

    Misspelt = type("Misspelt", (Mine,), {"citations": ("wang92",)})

    assert _keys(cite(Mine())) == ["fazeli2017", "mine2026"]
    with pytest.raises(UnknownNameError, match="wang92"):
        cite(Misspelt())


def test_every_key_is_known_and_every_reference_is_used():
    shipped = [law for family in laws.catalogue().values() for law in family.values()]
    shipped += [form for family in catalogue().values() for form in family]
    named = {key for kind in shipped if kind.__module__.startswith("contactlearn.") for key in kind.citations}
    methods = {"fazeli2017", "lange1989", "mackinnon1985", "rasmussen2006", "gardner2018", "titsias2009", "burt2020"}
    methods |= {"boggs1987", "fuller1987", "carroll2006"}
    assert named | methods == set(_references())
