"""A law with its effects for use elsewhere: as source of other languages, and in MuJoCo.

tracing    the arithmetic of a model as a list of operations on single numbers
source     one file of NumPy, JAX, PyTorch or C99
onnx       a graph of ONNX in float64
mujoco     a scene of MuJoCo, and a function that sets its coefficients
"""
