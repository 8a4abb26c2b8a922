"""One page that shows a run: report.html, self-contained and offline.

    diagnosis    a diagnosis as the data of its page; `effects` has its effects, experiment and residual
    evaluation   an evaluation as the data of its page
    runs         several runs side by side
    recordings   the recordings behind some impacts; `recording` has one of them, `sketches` small pictures
    reproduce    how a run is made again
    redraw       the page of a run folder, without its data source
    trials       every trial: state, variables, impulses of the laws and their reach
    arrays       the large arrays of a page as one block of bytes
    page         the data of a page and the templates to HTML
    templates    HTML, style and scripts; figures are drawn by plotly.js, which is part of the page

The page asks for nothing: its Content-Security-Policy allows its own two scripts, by their hashes, and no request.
"""
