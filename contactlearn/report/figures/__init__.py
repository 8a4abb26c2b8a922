"""Matplotlib figures, a PNG and a PDF each, in one style."""
