"""The panes of the page, in the order of the loop: functions from typed results to components.

A button that changes the session says so by `data-press`, its kind, and `data-of`, what it is about; a list or slider
by its identity `{"set": kind, "of": name}`.  The script of the page sends both to `contactlearn.workbench.actions`.
"""
