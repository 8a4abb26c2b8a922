"""Confounded effects, and the drops that discriminate between them."""

from contactlearn.diagnosis.discrimination import experiment as experiment, rivals as rivals
