"""Studies of the diagnosis' thresholds: cases with a known truth, and a decision that is made again under each value.

study       a study, a row of the table, and the walk over all thresholds
cases       data sets of physics that the analysis does not share, and ways of spoiling them
"""
