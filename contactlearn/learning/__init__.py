"""Learned models of the paper.

recipe   one model from one set of training trials
curves   every model over numbers of training trials, and on other bodies
"""
