"""What a reader sees of a comparison or a fit.

    terminal       what a run prints
    tables         per-trial results as files
    figures        the figures of the paper (2.3, 3.3 to 3.6) and the bound against a patch's width
    impulse_space  the first of these figures
    learning       the figures of learned models (4.1, 4.2), their calibration, transfer and training
    style          one look for all figures, one colour, marker and line a law or learned model

Figures show what other modules computed and fit nothing.  They are matplotlib `Figure` objects
that need no window system and are not kept alive by one.
"""
