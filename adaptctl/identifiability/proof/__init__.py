"""Ranks that are proved: geometry as exact numbers, energies over a large prime field or in many digits."""
