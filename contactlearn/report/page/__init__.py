"""One page that shows a run: report.html, self-contained and offline.

    content      a diagnosis as the data of the page
    comparison   an evaluation as the data of the page
    runs         several runs side by side: `runs_read` finds and checks them, `runs_settings` says in what they differ,
                 `runs_lines` draws learning curves across them
    words        verdicts, names and numbers in plain words
    trials       what both hold of every trial: state, variables, impulses of the laws and what these can reach
    arrays       the large arrays of a page as one block of bytes
    page         the data of a page and the templates to HTML
    templates    HTML, style and scripts; figures are drawn by plotly.js, which is part of the page

The page asks for nothing: its Content-Security-Policy allows its own two scripts, by their hashes, and no request.
"""
