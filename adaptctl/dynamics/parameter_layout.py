"""Parameter columns of bodies and drives."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from adaptctl.dynamics.recursion.drive import DriveTerm
from adaptctl.errors import InputError
from adaptctl.scalars import Column, Scalar


class ParameterLayout(NamedTuple):
    """Order of a mechanism's P parameters."""

    links: int
    bodies: tuple[int, ...]
    drives: tuple[DriveTerm, ...] = ()

    @property
    def driven(self) -> int:
        """Index of the drives' first parameter."""
        return 10 * len(self.bodies)

    @property
    def size(self) -> int:
        """Number P of parameters."""
        return self.driven + len(self.drives)

    def sorted_out(self, columns: Sequence[int]) -> tuple[dict[int, int], dict[int, int]]:
        """Parameter indices, sorted into bodies' and drives'."""
        of_bodies = {c: 10 * self.bodies[c // 10] + c % 10 for c in columns if c < self.driven}
        return of_bodies, {c: c - self.driven for c in columns if c >= self.driven}

    def tens(self, parameters: Column) -> Column:
        """Ten inertial parameters of each link (10 N,)."""
        if len(self.bodies) == self.links:
            return Column(parameters.of[: self.driven]) if self.drives else parameters
        tens: list[Scalar] = [0.0] * (10 * self.links)
        for place, i in enumerate(self.bodies):
            tens[10 * i : 10 * i + 10] = parameters.of[10 * place : 10 * place + 10]
        return Column(tens)

    def owned(self, tens: Column) -> Sequence[Scalar]:
        """Entries of ten per link, of links with parameters."""
        return [x for i in self.bodies for x in tens.of[10 * i : 10 * i + 10]]

    def of_drives(self, parameters: Column) -> Sequence[Scalar]:
        """Entries of all parameters (P,) that are the drives'."""
        return parameters.of[self.driven :]


def required_columns(columns: Sequence[int], known: int, name: str) -> Sequence[int]:
    """The parameter indices, checked."""
    if not isinstance(columns, Iterable):
        raise InputError(f"{name}: columns: expected whole numbers from 0 to {known - 1}, got {columns!r}")
    for c in columns:
        if not ((type(c) is int or isinstance(c, np.integer)) and 0 <= c < known):
            raise InputError(f"{name}: columns: expected whole numbers from 0 to {known - 1}, got {c!r}")
    return columns
