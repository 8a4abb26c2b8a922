"""Planted data whose physics is written independently of the package, and the diagnosis' score on it.

    path       impact along Routh's path in impulse space, in fine steps
    compliant  impact of a spring, a dashpot and a tangential spring, in time
    bodies     outlines and contact points
    forms      the planted effects, each in forms that the catalogue of the package need not have
    other_*    forms by another hand, for the half that is only reported
    nature     what happens to a body, and what a laboratory records of it
    noise      errors of instruments
    engines    drops of MuJoCo and of pymunk
    published  effects added to measured drops; table-tennis bounces
    sets       all sets by class
    judge      scores of the diagnoses, and the table
    run        the command

Nothing but `Impacts` and shapes is shared with the package: world axes x right, y up, floor below, SI units.
"""
