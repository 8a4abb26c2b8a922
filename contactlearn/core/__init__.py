"""Foundations that know nothing of contact: errors, events, numbers, files, devices, processes, signals."""

__version__ = "0.1.0"
