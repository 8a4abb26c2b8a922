"""Learned models of the paper.

recipe   one model from one set of training trials
events   rounds of a training, their held-out errors, points of learning curves
curves   learning curves of every model, and its transfer to other bodies
"""

from contactlearn.core.lazy import load_when_named

load_when_named(__name__)
