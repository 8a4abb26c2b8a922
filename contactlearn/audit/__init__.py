"""The audit: mistakes in the measurements themselves, before any physics is fitted to them.

findings      every mistake that was found, with its evidence and its correction
conventions   hypotheses about units and axes, compared
corrections   named corrections of measurements
averaging     velocities before impact that vary by noise alone
"""
