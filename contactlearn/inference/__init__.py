"""Everything that fits or scores a model: identification, evaluation, learning curves, validation on held-out folds."""

from contactlearn.core.lazy import load_when_named

load_when_named(__name__)
