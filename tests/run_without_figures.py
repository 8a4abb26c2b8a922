"""`python run_without_figures.py diagnose …`: a command that searches and draws no more than tests need."""

import sys

from commands import small_search, without_figures

from contactlearn.__main__ import main

if __name__ == "__main__":
    with small_search(), without_figures():
        sys.exit(main(sys.argv[1:]))
