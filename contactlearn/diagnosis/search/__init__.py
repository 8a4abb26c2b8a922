"""The search for missing effects: candidates, selection, ladder, and every subset of the chosen ones."""
