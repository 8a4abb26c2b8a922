"""The commands: settings are parsed, data loaded, results computed and written, then shown."""
