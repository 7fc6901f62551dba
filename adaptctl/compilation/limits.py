"""The largest mechanism whose equations become native code.

Tracing unrolls an equation for the mechanism at hand, so that code grows with the number of links, and LLVM's time
with it. Nobody should wait longer for a first call. Beyond the limit equations run in Python on floats, slower but the
same (`native_or_floats`); what only native code can do, such as lanes of many arms, refuses.
"""

LARGEST_COMPILED = 100
"""Links up to which equations are compiled. LLVM takes 6 s for the mass matrix of a chain of so many."""
