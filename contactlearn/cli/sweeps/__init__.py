"""Sweeps that go on where they stopped: jobs known by what they depend on, each in a folder named by it.

    identity    what the result of a job depends on: resolved configuration, data, code
    jobs        the jobs of a command line, and those among them that are finished
    resources   how many of them memory and cores allow at a time
    sweep       a whole sweep: plan, launcher, account
    rounds      launches what is left, whatever happens to single jobs, and lists what failed

`hydra_plugins.contactlearn_sweeper` is the door by which Hydra's `-m` comes here; any of its
launchers runs the jobs.
"""
