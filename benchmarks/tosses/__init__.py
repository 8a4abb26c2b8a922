"""Tosses of bodies in space with hidden physics, by two simulators that share no equation with the laws.

facts      hidden facts, their sizes, and the sets of both halves
engine     impacts by MuJoCo: a spring and dashpot, in steps of time
impulse    impacts in steps of impulse: Coulomb friction, restitution after Poisson or Stronge
run        asks the diagnosis, and scores its answers
"""
