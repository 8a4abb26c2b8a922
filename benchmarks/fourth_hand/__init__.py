"""Thirty sets with hidden physics, half of the unknown one along the sequence of the trials.

They are by somebody who knew the literature alone, of whom thirty tables were asked after the test of the sequence was
finished; nothing was changed for them.

    bodies          outlines and contact points
    laboratory      throws, impacts with what is changed in them, and noise
    sequence, state unknown physics: of the sequence of the trials, and of the state of each impact
    known           effects of the package's catalogue
    scenes          the thirty tables
    sets            their numbers and their files
    meanings        which names, and which words of the sequence, are right for what is hidden
    judge           the score of an answer
    run             the command

All but the last two need NumPy alone.  The laws of impact are those of `third_hand`: the author's own made the same
tables to the last digit.  World axes: x right, y up, floor below; SI units.
"""
