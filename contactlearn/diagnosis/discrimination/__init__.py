"""Confounded effects, and the drops that discriminate between them."""
