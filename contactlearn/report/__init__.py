"""What a reader sees of a comparison or a fit.

    terminal       what a run prints
    tables         per-trial results as files
    figures        the figures of the paper (2.3, 3.3 to 3.6) and the bound against a patch's width
    impulse_space  the first of these figures
    learning       learning curves and error densities (4.1, 4.2), and transfer to other bodies
    quality        one learned model's predictions, calibration and training
    diagnosis      what a diagnosis prints
    diagnosis_figures, audit_figures, effects   figures of a diagnosis, of its audit, of what each effect explains
    page           report.html: all of it on one page, alive in a browser
    style          one look for all figures, one colour, marker and line a law or learned model

Figures show what other modules computed and fit nothing.  They are matplotlib `Figure` objects
that need no window system and are not kept alive by one.
"""
