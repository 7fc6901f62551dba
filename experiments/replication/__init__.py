"""Sheu and Walker (1991) beside what is computed here: what they print, what comes out, and a verdict on each."""
