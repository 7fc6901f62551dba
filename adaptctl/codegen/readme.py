"""The README of an exported package."""

from __future__ import annotations

from adaptctl.codegen.c_package import CPackage
from adaptctl.compilation.sine import sine_for


def readme(package: CPackage) -> str:
    """The README, in Markdown, of an exported C `package`: how to build, use and check its code. Raises `TraceError`
    for a law that cannot be traced."""
    return package.filled(
        "README.md",
        flops=package.interface.law.operations.flops,
        state_bytes=package.state_bytes,
        stack=package.stack,
        far=f"{sine_for(package.number.precision).farthest:.0f}",
    )
