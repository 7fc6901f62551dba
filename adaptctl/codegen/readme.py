"""The README of an exported package."""

from __future__ import annotations

from adaptctl.codegen.c_package import CPackage
from adaptctl.compilation.sine import sine_for


def readme(package: CPackage) -> str:
    """Instructions for users of the code, in Markdown."""
    return package.filled(
        "README.md",
        flops=package.interface.law.operations.flops,
        state_bytes=package.state_bytes,
        stack=package.stack,
        far=f"{sine_for(package.number.precision).farthest:.0f}",
    )
