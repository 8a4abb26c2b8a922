"""Sixty-four sets with hidden physics: nothing, one effect or several with a name, and unknown physics of two kinds.

They are by somebody who knew the vocabulary and the literature, and named the effects at the end: a third of them by
soft contacts of which the laws of impact are the limit, bodies as they lie on a desk, four ways to throw them, and
formulas with their sources.

    bodies          outlines, and the point with which each touches the floor
    throws          how bodies are thrown
    instruments     errors of velocities and poses
    soft            springs in place of a law
    impact          the impact with what is hidden in it
    laboratory      which trials are thrown, and the table
    known           effects with a name
    state, sequence unknown physics: of the state of each impact, and of the sequence of the trials
    nothing, named, unnamed  the tables
    sets            their numbers and their files
    meanings        which words of what remains are right for unknown physics
    judge           the score of an answer
    run             the command

All but the last two need NumPy alone.  Laws of impact are those of `third_hand`, polygons and ellipses those of
`fourth_hand`: the author's own made the same tables to the last digit.  World axes: x right, y up, floor below; SI
units.
"""
