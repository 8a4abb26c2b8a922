"""The workbench: the loop of compare, see, learn, add and watch, live in a browser.

    session       all choices, immutable, written as the address of the page and read back
    lines         an effect as one line of mathematics
    commands      sessions as command line and experiment file, and back
    models        sessions to data, fits, errors, ladders and predicted gains, cached
    background    diagnoses and learning studies in processes of their own, which report events and can be cancelled
    arrays        numbers for the figures of the page, which are those of the report
    components, layout, content   the parts of the page
    session_callbacks, background_callbacks, files   what the controls do: to the session, to processes, with files
    security      refusal of foreign hosts, origins and requests without the token
    server        the command

The server has no state of a tab: a request brings its address, and caches can drop results without harm.
"""
