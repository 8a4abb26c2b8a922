"""Sweeps that resume where they stopped: jobs known by what they depend on, each in a folder named by it.

    identity    what the result of a job depends on: resolved configuration, data, code
    sweep       finds the jobs of a command line, launches those that are not finished, and prints what failed

Hydra's `-m` comes here through `hydra_plugins.contactlearn_sweeper`; any of its launchers runs the jobs.
"""
