"""Foundations that know nothing of contact: errors, events, numbers, files, devices, processes, signals."""

import sys

__version__ = "0.1.0"

if sys.platform == "win32":  # before anything is imported that is not there
    raise ImportError(
        "contactlearn does not run on Windows itself, for it needs signals and file locks of POSIX: "
        "install it in WSL, https://learn.microsoft.com/windows/wsl/install"
    )
