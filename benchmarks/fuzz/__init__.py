"""Coverage-guided fuzzing of everything that reads what others made: only documented errors may come out.

    tables       CSV and Parquet tables of impacts, under any names, units and shapes
    mat          the published .mat, with the checksum of whatever is read
    recordings   tracks: CSV, Parquet, Motive, TUM; HDF5, C3D, ROS bags and MCAP with contactlearn[tracks]
    formulas     effects from lines of mathematics, read, tried on measurements and used
    overrides    the words of a command line, composed and checked
    checkpoints  model files: whole ones, their pickle, their description
    target       what a target is, and what is made of it
    run          the command

Each target is a function from bytes; tests/corpus holds small inputs of each, which the tests replay.
"""
