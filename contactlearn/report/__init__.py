"""Reports of a run: terminal, figures, TensorBoard and pages, all in the words and number formats of `text`.

    text          words and number formats
    terminal      lines and tables of train and evaluate
    events        the events of a run on the terminal, and the verdict of a diagnosis
    tensorboard   scalars, charts, pictures and the card of a run
    sweep_curves  learning curves of a sweep in TensorBoard
    figures       matplotlib figures: laws, comparison, impulse_space, learning, quality of the paper's experiments;
                  audit, regions, residual, effects, diagnosis of a diagnosis; style is common to all
    page          report.html of a run, and of several runs side by side

Nothing is fitted here: results are complete before they are shown.  Figures are matplotlib `Figure` objects that need
no window system and are not kept alive by one.
"""

from contactlearn.core.lazy import load_when_named

load_when_named(__name__)
