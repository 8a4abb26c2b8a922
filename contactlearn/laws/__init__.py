"""Analytical models of planar impact: pure functions (W, v_c, μ, ε) → P, one a file.

`impulse` evaluates any of them by name, batched over trials and leading parameter axes;
`Law` is a law with its parameters.  Each law has two variants, see docs/notation.md:
`textbook`, and `fazeli2017`, what the paper's authors computed.
"""

from contactlearn.laws.law import PAPER_LAWS, Law, check, impulse, names

__all__ = ["PAPER_LAWS", "Law", "check", "impulse", "names"]
