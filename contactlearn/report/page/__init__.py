"""One page that shows a run: report.html, self-contained and offline.

    page         the data of a page and the templates to HTML; large arrays as one block, how a run is made again
    diagnosis    a diagnosis as the data of its page; `effects` has its effects, experiment and residual
    evaluation   an evaluation as the data of its page
    trials       every trial: state, variables, outcomes and errors of the models, impulses of the laws and their reach
    recordings   the recordings behind some impacts
    runs         pages from run folders alone: one run again, several side by side
    templates    HTML, style and scripts; plotly.js, which is part of the page, shows the figures of `report.figures`

The page asks for nothing: its Content-Security-Policy allows its own two scripts, by their hashes, and no request.
"""
