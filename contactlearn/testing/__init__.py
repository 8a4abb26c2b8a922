"""Tests that the package of an effect or a law of your own can inherit.

effects   what every effect must obey: `EffectContract`
laws      what every law must obey: `LawContract`
"""

from contactlearn.testing.effects import EffectContract
from contactlearn.testing.laws import LawContract

__all__ = ["EffectContract", "LawContract"]
