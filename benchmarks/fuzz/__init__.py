"""Coverage-guided fuzzing of all readers of foreign input: only documented errors may come out."""
