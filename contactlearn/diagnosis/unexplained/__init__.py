"""The remainder that flexible models predict and no named effect explains, and formulas for it."""
