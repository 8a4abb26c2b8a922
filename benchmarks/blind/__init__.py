"""Blind test sets: frozen tables with hidden physics, and the diagnosis' score on them.

data        a folder a suite: impacts.parquet, and truth.json with the ground truth
load        impacts as they were handed over, without the truth
judge       the answer of a diagnosis, the truth, and the score
report      tables of the scores
run         the command
calibrate   the command that fits the stated probabilities to a half of the independent suite
"""
