"""Coverage-guided fuzzing of all readers of foreign input: only documented errors may come out.

tables       CSV and Parquet tables of impacts
mat          the published .mat
recordings   tracked poses: CSV, Parquet, Motive, TUM; HDF5, C3D, ROS bags and MCAP with contactlearn[tracks]
formulas     effects from lines of mathematics
overrides    the words of a command line
checkpoints  model files
target       a target and the judge of its results
run          the command
"""
