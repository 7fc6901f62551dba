"""Gains of many arms: one set for all, or one each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, numbers
from adaptctl.control.controller import Controller
from adaptctl.errors import InputError

NONE: Mapping[str, Array] = MappingProxyType({})


@dataclass(frozen=True, eq=False)
class GainsOfMany:
    """Gains (tunable numbers) of M arms' controllers, which differ in nothing else. `controller` is the controller of
    all; `given` maps names in `controller.numbers`, such as "bandwidth", to arrays in the shapes and units that they
    have there, the same for all arms, or with a leading axis of M. Numbers not given are those of the `controller`.
    `GainsOfMany.of` checks them; the class itself checks nothing."""

    controller: Controller[Any]
    given: Mapping[str, Array]

    @classmethod
    def of(
        cls,
        controller: Controller[Any],
        given: Mapping[str, ArrayLike],
        own: Mapping[str, Array] = NONE,
    ) -> GainsOfMany:
        """The `GainsOfMany`, gains of the controllers of M arms, from one of two mappings of names in
        `controller.numbers`, such as "bandwidth", to arrays. In `given` each array has the shape that the number has in
        the `controller`, the same for all arms, or a leading axis of M before it. In `own`, empty by default, each has
        that axis: the numbers of M controllers that exist already, which are not checked again. Both may be empty: then
        all arms have the controller's own gains.

        Each arm's gains in `given` are checked by the controller's constructor. Raises `InputError` where neither
        mapping is empty and for arrays of another shape or of no numbers, `NotFoundError` for an unknown name, and what
        the controller's class raises for its numbers, such as `GainError`.
        """
        if own and given:
            raise InputError("gains: expected none besides those of a sequence of controllers")
        if own:
            return cls(controller, own)
        controller.tuned({name: controller.numbers.get(name, values) for name, values in given.items()})
        gains = cls(controller, {name: numbers(values, name) for name, values in given.items()})
        for name, values in gains.given.items():
            shape = controller.numbers[name].shape
            if values.shape not in (shape, (*values.shape[:1], *shape)):
                raise InputError(f"gains: {name}: expected shape {shape}, or {('M', *shape)}, got {values.shape}")
        gains.require()
        return gains

    @property
    def arms(self) -> dict[str, tuple[int, ...]]:
        """The leading axes of each gain given, by its name with the word "gains" before it, as in "gains bandwidth".
        They are (M,) where the gain has a row for each of M arms, () where it is the same for all; the mapping is empty
        where no gain is given."""
        sizes = {name: x.ndim - self.controller.numbers[name].ndim for name, x in self.given.items()}
        return {f"gains {name}": self.given[name].shape[:axes] for name, axes in sizes.items()}

    def require(self) -> None:
        """Raise what the controller's class raises for its numbers, such as `InputError` and `GainError`, unless each
        arm's set of gains would make a controller. Gains with unlike numbers of rows are not checked; `simulate_many`
        refuses them."""
        if not self.given:
            return
        count = max((axes[0] for axes in self.arms.values() if axes), default=1)
        if any(axes not in ((), (count,)) for axes in self.arms.values()):
            return  # refused with all that has a row each
        each = self._rows(slice(0, count), count)
        self._try_largest(each)
        rows = np.concatenate([x.reshape(count, -1) for x in each.values()], axis=1)
        for k in np.unique(rows, axis=0, return_index=True)[1].tolist():
            self.controller.tuned({name: x[k] for name, x in each.items()})

    def _try_largest(self, each: Mapping[str, Array]) -> None:
        """Try the largest of every number together: where they are accepted, so is what needs less, without a search
        for each set (`require_hold`)."""
        with suppress(InputError):
            self.controller.tuned({name: x.max(axis=0) for name, x in each.items()})

    def of_arms(self, arms: slice) -> dict[str, Array]:
        """All tunable numbers of the controllers of M arms, by their names in `Controller.numbers`: arrays (M, ...) in
        the shapes and units that they have there. The slice `arms`, with a start and a stop, selects the M arms. The
        dict is empty where no gain is given. Nothing is checked."""
        if not self.given:
            return {}
        count = arms.stop - arms.start
        own = {name: np.broadcast_to(x, (count, *x.shape)) for name, x in self.controller.numbers.items()}
        return own | self._rows(arms, count)

    def packed(self, arms: slice) -> Array:
        """All g tunable numbers of the controllers of M arms in one array (M, g), in the order of `Controller.numbers`,
        matrices row by row. The slice `arms`, with a start and a stop, selects the M arms. Raises `ValueError` where no
        gain is given."""
        return np.concatenate([x.reshape(len(x), -1) for x in self.of_arms(arms).values()], axis=1)

    def _rows(self, arms: slice, count: int) -> dict[str, Array]:
        rows = {name: x[arms] if self.arms[f"gains {name}"] else x for name, x in self.given.items()}
        return {name: np.broadcast_to(x, (count, *self.controller.numbers[name].shape)) for name, x in rows.items()}


def alike(given: Controller[Any] | Sequence[Controller[Any]]) -> tuple[Controller[Any], dict[str, Array]]:
    """A controller that stands for all those `given`, and a dict of their own tunable numbers, such as gains. For a
    sequence of M controllers it is the first, and the dict maps the names in `Controller.numbers` to arrays (M, ...), a
    row for each in the shape and unit that the number has there; for one controller alone it is that one and an empty
    dict. Raises `InputError` for an empty sequence, for an element that is no `Controller`, and where controllers
    differ in more than these numbers."""
    if isinstance(given, Controller):
        return given, {}
    controllers = list(given) if isinstance(given, Sequence) else []
    if not controllers or not all(isinstance(one, Controller) for one in controllers):
        raise InputError(f"controller: expected a Controller or a sequence of them, got {given!r}")
    first = controllers[0]
    for k, one in enumerate(controllers):
        if one.structure != first.structure:
            raise InputError(f"controller: expected any to differ in numbers alone, number {k} does not")
    return first, {name: np.stack([one.numbers[name] for one in controllers]) for name in first.numbers}
