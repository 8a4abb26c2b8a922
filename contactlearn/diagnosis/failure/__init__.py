"""Regions of the input space in which a model fails, and the variables that describe them."""
