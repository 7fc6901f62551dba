"""Members of a batch of arms."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adaptctl.arrays import Array, numbers, whole_count
from adaptctl.control.adaptation.law import AdaptationLaw
from adaptctl.control.controller import Controller
from adaptctl.dynamics.loops.single_precision import validate_single_precision
from adaptctl.errors import InputError, shown
from adaptctl.scalars import Tunable
from adaptctl.simulation.closed_loop import ClosedLoop

Seeds: TypeAlias = int | NDArray[np.object_] | None
"""One seed for all arms, one per arm, or None for new noise."""


def checked_seeds(given: object) -> Seeds:
    """Checked seeds, else `InputError`."""
    if given is None:
        return None
    each = np.asarray(given, dtype=np.object_)
    for seed in each.flat:
        whole_count(seed, "seed")
    return each if each.ndim else int(each[()])


class Noise(NamedTuple):
    """Standard normal sensor noise of many arms."""

    generators: Sequence[np.random.Generator]
    members: int
    size: int

    @classmethod
    def of(cls, seed: Seeds, members: int, batch: int, size: int) -> list[Noise]:
        """Sources for groups of at most `batch` arms."""
        counts = [min(batch, members - first) for first in range(0, members, batch)]
        if isinstance(seed, np.ndarray) and size:
            each = [np.random.default_rng(int(x)) for x in seed]
            return [cls(each[k * batch : k * batch + n], n, size) for k, n in enumerate(counts)]
        root = np.random.SeedSequence(seed if isinstance(seed, int) else None)
        sources = [root, *root.spawn(len(counts) - 1)]
        return [cls([np.random.default_rng(x)], n, size) for x, n in zip(sources, counts, strict=True)]

    def drawn(self, steps: int) -> Array:
        """Noise (steps, M, size) of the next control periods."""
        if len(self.generators) == 1:
            return self.generators[0].standard_normal((steps, self.members, self.size))
        return np.stack([rng.standard_normal((steps, self.size)) for rng in self.generators], axis=1)


def differing(
    controller: Controller[Any] | Sequence[Controller[Any]], gains: Mapping[str, ArrayLike]
) -> tuple[Controller[Any], dict[str, Array]]:
    """One controller for M arms, and their numbers by name."""
    one = controller if isinstance(controller, Controller) else _first_of(controller)
    if one is not controller and one.numbers:
        if gains:
            raise InputError("gains: not allowed with a sequence of controllers")
        laws: Any = controller
        return one, {name: np.stack([law.numbers[name] for law in laws]) for name in one.numbers}
    one.tuned({name: one.numbers.get(name, values) for name, values in gains.items()})
    given = {name: numbers(values, name) for name, values in gains.items()}
    for name, values in given.items():
        shape = one.numbers[name].shape
        if values.shape not in (shape, (*values.shape[:1], *shape)):
            raise InputError(f"gains: {name}: expected shape {shape}, or {('M', *shape)}, got {values.shape}")
    counts = {axes[0] for axes in arms_of(one, given).values() if axes}
    if given and len(counts) < 2:  # else refused with all that has a row each
        _require(one, {name: gains_of(one, given, max(counts, default=1))[name] for name in given})
    return one, given


def arms_of(controller: Controller[Any], given: Mapping[str, Array]) -> dict[str, tuple[int, ...]]:
    """Leading axes of gains by name, (M,) or ()."""
    return {name: x.shape[: x.ndim - controller.numbers[name].ndim] for name, x in given.items()}


def gains_of(controller: Controller[Any], given: Mapping[str, Array], count: int) -> dict[str, Array]:
    """Gains (count, ...) of the arms by name, defaults included."""
    own = controller.numbers if given else {}
    return {name: np.broadcast_to(given.get(name, x), (count, *x.shape)) for name, x in own.items()}


def joined_gains(each: Mapping[str, Array]) -> Array:
    """Rows (count, ...) of all gains of each arm, one after the other."""
    return np.concatenate([x.reshape(len(x), -1) for x in each.values()], axis=1)


def _require(controller: Controller[Any], each: Mapping[str, Array]) -> None:
    rows = joined_gains(each)
    for k in np.unique(rows, axis=0, return_index=True)[1].tolist():
        controller.tuned({name: x[k] for name, x in each.items()})


def _first_of(given: object) -> Controller[Any]:
    laws = list(given) if isinstance(given, Sequence) else []
    if not laws or not all(isinstance(one, Controller) for one in laws):
        raise InputError(f"controller: expected a Controller or a sequence of them, got {shown(given)}")
    for k, one in enumerate(laws):
        if one.structure != laws[0].structure:
            raise InputError(
                f"controller: the controllers may differ only in numbers, but number {k} differs otherwise"
            )
    return laws[0]


MAX_FLOAT32_PERIODS = 2**24
"""control periods that single precision counts exactly"""


def validate_single(loop: ClosedLoop, steps: int) -> None:
    """Raise `InputError` if a closed loop needs double precision."""
    validate_single_precision(loop.plant.mechanism, "precision")
    for part in _parts(loop.controller):
        if isinstance(part, AdaptationLaw) and part.needs_double:
            kind = type(part).__name__
            raise InputError(f"precision: single precision is too inaccurate for the forgetting of {kind}: use double")
    if steps > MAX_FLOAT32_PERIODS:
        raise InputError(
            f"precision: single precision counts to {MAX_FLOAT32_PERIODS} control periods, got {steps}: use double"
        )


def _parts(law: Tunable) -> Iterator[Tunable]:
    yield law
    for part in law.tunable_parts.values():
        yield from _parts(part)
