"""Blind test sets: frozen tables with hidden physics, and the diagnosis' score on them."""
