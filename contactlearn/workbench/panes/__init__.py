"""The panes of the page, in the order of the loop: functions from typed results to components.

A component that changes the session has an identity `{"set": kind, "of": name}` with a value, or `{"press": kind,
"of": name}` with clicks; `contactlearn.workbench.actions` says what each does.
"""
