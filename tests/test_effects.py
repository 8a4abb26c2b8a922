"""Every effect of the catalogue obeys the contract."""

import pytest

from contactlearn.effects import catalogue
from contactlearn.testing import EffectContract

CASES = [
    effect if form is None else type(effect)(form=form)
    for effect in (kind() for kind in catalogue().values())
    for form in (effect.formula if isinstance(effect.formula, dict) else [None])
]


@pytest.mark.parametrize("law", ["wang_mason", "mirtich"])
@pytest.mark.parametrize("effect", CASES, ids=lambda effect: f"{effect.name}-{getattr(effect, 'form', '')}")
class TestCatalogue(EffectContract):
    @pytest.fixture(autouse=True)
    def _chosen(self, effect, law):
        self.effect, self.law = effect, law
