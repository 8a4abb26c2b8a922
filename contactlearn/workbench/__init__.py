"""The workbench: the loop of compare, see, learn, add and watch, live in a browser.

    session    everything that is chosen, immutable, written as the address of the page and read back
    lines      an effect as one line of mathematics
    cache      results by configuration and data, each computed once, the oldest forgotten
    models     sessions to data, fits, errors and ladders
    promises   the error that each effect of the catalogue would leave, from a linearisation
    commands   sessions as command line and experiment file, and back
    jobs       diagnoses in processes of their own, which can be cancelled
    studies    learning curves and learned models, step by step
    tasks      studies in processes of their own, which can be cancelled
    saved      run folders below `outputs`
    arrays     numbers for the figures of the page, which are those of the report
    previews   answers to a slider that is being dragged
    security   refusal of foreign hosts, origins and requests without the token
    panes/     the parts of the page as components
    page       the page and its callbacks
    server     the command

The server keeps no state of a tab: a request brings its address, and caches forget without harm.
"""
