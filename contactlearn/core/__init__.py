"""Foundations that know nothing of contact: errors, numbers, files, devices, processes, signals."""

__version__ = "0.1.0"
