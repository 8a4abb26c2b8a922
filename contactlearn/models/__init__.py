"""Contact models: law, effects and learned residual behind one `predict`; Gaussian processes; checkpoints; citations.

contact_model     `ContactModel` and its `predict`
regressor         standardised processes from features to impulse, wrench, velocity or (μ, ε)
standardisation   features and outputs by the statistics of the training trials
process_options   kernel, mean, likelihood and optimiser of processes
gp                exact and sparse Gaussian processes, many at once
checkpoint        models to and from a file that executes nothing
roll_out          trajectories of flights and bounces
export            law and effects as NumPy, JAX, PyTorch or C
citation          BibTeX of whatever a model uses
"""

TYPE_CHECKING = False
if not TYPE_CHECKING:  # with it a type checker would take any name for one of this room
    from contactlearn.core.lazy import submodules

    __getattr__, __dir__ = submodules(__name__, __path__)
