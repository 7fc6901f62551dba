"""Arms that run together, and what may differ among them: gains, noise, precision."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adaptctl.arrays import Array, numbers, whole_count
from adaptctl.control.adaptation.law import AdaptationLaw
from adaptctl.control.controller import Controller
from adaptctl.dynamics.loops.single_precision import validate_single_precision
from adaptctl.errors import InputError
from adaptctl.scalars import Tunable
from adaptctl.simulation.closed_loop import ClosedLoop

Seeds: TypeAlias = int | NDArray[np.object_] | None
"""One seed for all arms, an array of one for each, or None for another noise each time."""


def checked_seeds(given: object) -> Seeds:
    """The seeds `given` of many arms' noise: None, a whole number of at least 0, or, made of a list or array of such
    numbers, an array of them of the same shape. Raises `InputError` for all else, such as 2.0, texts and booleans."""
    if given is None:
        return None
    each = np.asarray(given, dtype=np.object_)
    for seed in each.flat:
        whole_count(seed, "seed")
    return each if each.ndim else int(each[()])


class Noise(NamedTuple):
    """Source of sensor noise for M = `members` arms: independent standard normal numbers, without a unit, `size` of
    them for each arm in a control period. `generators` has one random generator for all arms, or one for each. Nothing
    is checked."""

    generators: Sequence[np.random.Generator]
    members: int
    size: int

    @classmethod
    def of(cls, seed: Seeds, members: int, batch: int, size: int) -> list[Noise]:
        """Sources of sensor noise for `members` arms, a list with one `Noise` for each group of at most `batch` arms,
        in the arms' order; an arm takes `size` numbers in a control period. `seed` is one whole number for all arms,
        None for another noise each time, or an array of one for each arm, whose noise then does not depend on the other
        arms; the same seeds give the same noise. Raises `ValueError` for a seed below 0."""
        counts = [min(batch, members - first) for first in range(0, members, batch)]
        if isinstance(seed, np.ndarray) and size:
            each = [np.random.default_rng(int(x)) for x in seed]
            return [cls(each[k * batch : k * batch + n], n, size) for k, n in enumerate(counts)]
        root = np.random.SeedSequence(seed if isinstance(seed, int) else None)
        sources = [root, *root.spawn(len(counts) - 1)]
        return [cls([np.random.default_rng(x)], n, size) for x, n in zip(sources, counts, strict=True)]

    def drawn(self, steps: int) -> Array:
        """Standard normal numbers (steps, M, size), without a unit, of the next `steps` control periods of M arms,
        `size` for each arm in a period. Each call draws new ones, the same sequence for the same seeds. Raises
        `ValueError` for `steps` below 0."""
        if len(self.generators) == 1:
            return self.generators[0].standard_normal((steps, self.members, self.size))
        return np.stack([rng.standard_normal((steps, self.size)) for rng in self.generators], axis=1)


def differing(
    controller: Controller[Any] | Sequence[Controller[Any]], gains: Mapping[str, ArrayLike]
) -> tuple[Controller[Any], dict[str, Array]]:
    """One controller that stands for those of M arms, and the tunable numbers in which they differ, a pair. The numbers
    are arrays by name, in the shapes and units of `controller.numbers`, the same for all arms, or with a leading axis
    of M. They are those of a sequence of controllers, which differ in their numbers alone, or the `gains` given for one
    controller, which its constructor checks for each arm.

    Raises `InputError` for an empty sequence, for what is no `Controller`, for controllers that differ in more or come
    with gains, and for arrays of another shape or of no numbers, `NotFoundError` for an unknown name, and what the
    controller's class raises for its numbers, such as `GainError`."""
    one = controller if isinstance(controller, Controller) else _first_of(controller)
    if one is not controller and one.numbers:
        if gains:
            raise InputError("gains: expected none besides those of a sequence of controllers")
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
    """The leading axes of each gain `given` by its name in `controller.numbers`: (M,) where it has a row for each of M
    arms, () where it is the same for all. Raises `KeyError` for an unknown name."""
    return {name: x.shape[: x.ndim - controller.numbers[name].ndim] for name, x in given.items()}


def gains_of(controller: Controller[Any], given: Mapping[str, Array], count: int) -> dict[str, Array]:
    """All tunable numbers of `count` arms, by their names in `controller.numbers`: arrays (count, ...) in the shapes
    and units there, the controller's own where not `given`. The dict is empty where no gain is given. Nothing is
    checked."""
    own = controller.numbers if given else {}
    return {name: np.broadcast_to(given.get(name, x), (count, *x.shape)) for name, x in own.items()}


def _require(controller: Controller[Any], each: Mapping[str, Array]) -> None:
    """Raise what the controller's class raises for its numbers, unless each arm's would make a controller.

    The largest of every number are tried first: where they are accepted, so is what needs less, without a search for
    each set (`validate_sampling_ratio`)."""
    with suppress(InputError):
        controller.tuned({name: x.max(axis=0) for name, x in each.items()})
    rows = np.concatenate([x.reshape(len(x), -1) for x in each.values()], axis=1)
    for k in np.unique(rows, axis=0, return_index=True)[1].tolist():
        controller.tuned({name: x[k] for name, x in each.items()})


def _first_of(given: object) -> Controller[Any]:
    """The first of a sequence of controllers that differ in numbers alone."""
    laws = list(given) if isinstance(given, Sequence) else []
    if not laws or not all(isinstance(one, Controller) for one in laws):
        raise InputError(f"controller: expected a Controller or a sequence of them, got {given!r}")
    for k, one in enumerate(laws):
        if one.structure != laws[0].structure:
            raise InputError(f"controller: expected any to differ in numbers alone, number {k} does not")
    return laws[0]


LONGEST = 2**24
"""Control periods that single precision can count."""


def validate_single(loop: ClosedLoop, steps: int) -> None:
    """Raise `InputError` unless a closed loop can be simulated in single precision (float32) for so many `steps`,
    control periods. It cannot where that leaves the mechanism's kinematic loops open by more than 1e-5 m or rad; with
    an adaptation law whose internal state is a k x k matrix for k parameters, as its small eigenvalues would be lost;
    and for more than 2^24 periods, the most that it counts. Raises `LoopError`, a subclass of it, where loops cannot be
    closed."""
    validate_single_precision(loop.plant.mechanism, "precision")
    for part in _parts(loop.controller):
        if isinstance(part, AdaptationLaw) and part.needs_double:
            kind = type(part).__name__
            raise InputError(f"precision: single precision loses the matrix in which {kind} forgets: use double")
    if steps > LONGEST:
        raise InputError(f"precision: single precision counts to {LONGEST} control periods, got {steps}: use double")


def _parts(law: Tunable) -> Iterator[Tunable]:
    """A law, and the laws that it is made of."""
    yield law
    for part in law.tunable_parts.values():
        yield from _parts(part)
