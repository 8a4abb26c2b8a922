"""Forty-eight sets with hidden physics, by somebody who knew the literature and nothing of the package.

    laws       laws of planar impact: Routh's path, final slip, Whittaker, Drumwright and Shell
    bodies     outlines and contact points
    effect     what is hidden: the places where it can act
    motion     effects of the set-up, of the wrench and of the motion after contact
    material   effects in restitution and friction
    beyond     physics that no table shows, and mistakes of measurement
    designs    how bodies are dropped and thrown
    noise      errors of instruments
    nature     from a scene to a table
    known, others  the scenes
    sets       their numbers and their files
    meanings   which names of the package's catalogue are right for what is hidden
    judge      what a diagnosis said, and its score
    run        the command

All but the last two need NumPy alone.  World axes: x right, y up, floor below; SI units.
"""
