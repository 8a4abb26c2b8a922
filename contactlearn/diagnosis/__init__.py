"""Diagnosis: from measurements and a contact model to a named missing effect, or to what can be said instead.

audit, frame, spread      what is wrong with the measurements themselves, and what hardly varies
budget, noise             how much of the error is noise, explained, or out of reach
regions, variables        where a model fails
candidates, selection     which effects may be missing, and which are
equivalents, contest      what cannot be told apart on these data
experiment                the drops that would tell
remainder                 what processes still find
formulas, library         lines of mathematics for it
ladder, subsets           errors with effect after effect, and with every choice of them
diagnosis                 all of it in order, and what comes of it
"""
