"""An effect from one line of mathematics over documented symbols; nothing is ever evaluated as code.

expression   parses and evaluates a line
symbols      the quantities that a line can name, with units
effect       the effect that a line describes
"""

from contactlearn.effects.formula.effect import LawFormula, StateFormula, VelocityFormula, WrenchFormula, formula

__all__ = ["LawFormula", "StateFormula", "VelocityFormula", "WrenchFormula", "formula"]
