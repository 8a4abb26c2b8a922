"""Fifty-six sets with hidden physics: nothing, one effect or several with a name, and unknown physics of two kinds.

They are by somebody who knew the literature and the names of the catalogue alone, and who was asked for tables as a
laboratory hands them over: errors before impact that are as large as those after it, contact points computed from a
pose with errors, coefficients that scatter, and errors that follow one another where nothing is hidden.

    bodies          contact points of bodies, and their weights
    throws          how bodies are thrown
    instruments     errors of velocities and poses
    laboratory      the impact with what is hidden in it, and the table
    known           effects with a name
    state, sequence unknown physics: of the state of each impact, and of the sequence of the trials
    nothing, named, unnamed  the tables
    sets            their numbers and their files
    meanings        which names, and which words of what remains, are right for what is hidden
    judge, report   the score of an answer, and tables of all
    run             the command

All but the last three need NumPy alone.  Laws of impact are those of `third_hand`, outlines those of `fourth_hand`: the
author's own made the same tables to the last digit.  World axes: x right, y up, floor below; SI units.
"""
