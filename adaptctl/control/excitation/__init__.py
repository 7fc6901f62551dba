"""Persistent excitation of a motion, measured, and references made to excite the parameters."""
