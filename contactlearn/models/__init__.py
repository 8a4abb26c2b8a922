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

from contactlearn.core.lazy import load_when_named

load_when_named(__name__)
