"""Diagnosis: from measurements and a contact model to a named missing effect, or to what can be said instead.

audit, frame          what is wrong with the measurements themselves
selection             which effects of the catalogue are missing
regions, variables    where a model fails
diagnosis             all of it in order, and what comes of it
"""
