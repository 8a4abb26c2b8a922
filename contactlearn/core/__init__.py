"""Foundations that know nothing of contact: errors, numbers, files, devices, processes, signals."""
