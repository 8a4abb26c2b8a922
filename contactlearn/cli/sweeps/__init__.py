"""Sweeps that resume where they stopped: jobs known by what they depend on, each in a folder named by it.

    identity    what the result of a job depends on: resolved configuration, data, code
    resolvers   names of the folders of jobs, in `hydra.sweep.subdir`
    sweep       the folder of a sweep and of each job, and the table at the end

Hydra's own sweepers and launchers run the jobs.
"""
