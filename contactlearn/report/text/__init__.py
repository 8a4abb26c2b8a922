"""The words and number formats of terminal, page, figures and run cards, each in one place.

    sentences    templates of all sentences about a diagnosis, an evaluation and fitted parameters
    names        laws, models, effects, rungs and components as a person writes them; lists and sentences
    numbers      errors, shares, comparisons
    tracks       impacts found in recordings

A no-break space stands between a number and its % sign; the terminal prints it as a space.
"""
