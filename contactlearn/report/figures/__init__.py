"""Matplotlib figures, a PNG and a PDF each, in one style.

    laws            identified parameters: cost surface, convergence, trial by trial (Figs. 3.3, 3.4, 3.6)
    comparison      errors by model, and the IRB bound against a patch's width (Fig. 3.5)
    impulse_space   one impact in impulse space (Fig. 2.3), and the reach of each law in it
    learning        learning curves, error densities, transfer to other bodies (Figs. 4.1, 4.2)
    quality         predictions, calibration and training of one learned model
    effects         partial residuals of each effect
    diagnosis       all figures of a diagnosis by file name: ladder, frontier, regions, residual, evidence of findings
    browser         a figure as plotly shows it in the report and the workbench
    style           sizes, colours, markers and lines; text that is never markup; saving

The figure numbers are those of Fazeli et al. (2017).
"""
