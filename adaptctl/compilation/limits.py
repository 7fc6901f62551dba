"""How large a mechanism may be to become native code."""

LARGEST_COMPILED = 48
"""Links up to which the first call takes seconds, 4 s for a plant of so many; beyond, the same law runs on floats."""
