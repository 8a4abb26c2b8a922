"""What a reader sees: static figures of a comparison or a fit.

    style    one look for all figures, one colour and marker a law, and `save`
    figures  the figures of the paper (2.3, 3.3 to 3.6) and the bound against a patch's width

Figures show what other modules computed and fit nothing.  They are matplotlib `Figure` objects
that no window system or global state knows of, so they can be made in any thread or process.
"""
