"""File of what a controller has learned, and a start from it."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from adaptctl.arrays import real_number
from adaptctl.control.adaptation.guarded_learning import GuardedLearning
from adaptctl.control.adaptive import AdaptiveState
from adaptctl.control.energy_tank import EnergyTank
from adaptctl.control.slotine_li import SlotineLi
from adaptctl.errors import InputError
from adaptctl.files import hashed, read_json, write_json

CLOCK_ERROR = 60.0
"""s by which clocks of machines may differ"""


class Numbers(msgspec.Struct, forbid_unknown_fields=True):
    """Estimate in SI units, gain, and information and z in units of the gain."""

    gain: list[float]
    estimate: list[float]
    information: list[float]
    known: list[float]


class LearnedFile(msgspec.Struct, forbid_unknown_fields=True):
    """Content of the file, with the time in s since 1970 and hashes of the geometry and of time and numbers."""

    schema: Literal["adaptctl/learned/2"]
    mechanism: str
    geometry_sha256: str
    saved_at: float
    parameters: list[str]
    numbers: Numbers
    sha256: str

    @property
    def unchanged(self) -> bool:
        """True if time and numbers are those that were saved."""
        return self.sha256 == _hash(self.saved_at, self.numbers)


def _hash(saved_at: float, numbers: Numbers) -> str:
    return hashed([saved_at, msgspec.to_builtins(numbers)])


def save_learned(path: str | Path, controller: SlotineLi, state: AdaptiveState) -> None:
    """
    Write the estimate of a `GuardedLearning`, and the information behind it, to a JSON file.

    Parameters
    ----------
    path : str or Path
        File to write; one that exists is replaced.
    controller : SlotineLi
        Controller with `GuardedLearning`.
    state : AdaptiveState
        State of one arm. While torques are missed, the estimate that was trusted before is written.

    Raises
    ------
    InputError
        If the law is another, or the state is of several arms.
    FileError
        If the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> controller = adaptctl.SlotineLi(model, 5.0, 4.0, adaptctl.control.GuardedLearning(np.full(6, 0.1)))
    >>> state, path = controller.init(p, v), tempfile.mkdtemp() + "/learned.json"
    >>> adaptctl.control.save_learned(path, controller, state)
    >>> adaptctl.control.warm_start(path, controller, state).estimate
    array([0., 0., 0., 0., 0., 0.])
    """
    law = _law(controller, state)
    memory = state.law_state
    trusted = memory.watch.trusted if float(memory.watch.alarm[0]) > 0.0 else state.estimate
    counts = float(memory.stored.valid[0])
    arrays = law.gain, trusted, memory.stored.remembered, counts * memory.stored.known
    numbers = Numbers(*(np.asarray(x, dtype=np.float64).tolist() for x in arrays))
    mechanism, names = controller.model.mechanism, list(controller.model.names)
    now = time.time()
    about = mechanism.name, mechanism.geometry_sha256, now, names
    write_json(path, LearnedFile("adaptctl/learned/2", *about, numbers, _hash(now, numbers)))


def warm_start(
    path: str | Path, controller: SlotineLi, state: AdaptiveState, *, max_age: float = float("inf")
) -> AdaptiveState:
    """
    Return the state of a controller that begins with what `save_learned` wrote.

    Parameters
    ----------
    path : str or Path
        File of the same model; gains may differ.
    controller : SlotineLi
        Controller with `GuardedLearning`.
    state : AdaptiveState
        State of one arm, as of `init`.
    max_age : float, default infinity
        Age of the file in s above which it is refused. By default any: friction and tools change, links do not.

    Returns
    -------
    AdaptiveState
        State with the estimate and the information of the file. What is doubted starts anew.

    Raises
    ------
    InputError
        If the file is of another model or too old, or as for `save_learned`.
    FileError
        If the file cannot be read.

    Examples
    --------
    >>> import tempfile
    >>> controller = adaptctl.SlotineLi(model, 5.0, 4.0, adaptctl.control.GuardedLearning(np.full(6, 0.1)))
    >>> state, path = controller.init(p, v), tempfile.mkdtemp() + "/learned.json"
    >>> adaptctl.control.save_learned(path, controller, state._replace(estimate=np.ones(6)))
    >>> adaptctl.control.warm_start(path, controller, state, max_age=3600.0).estimate
    array([1., 1., 1., 1., 1., 1.])
    """
    law, file = _law(controller, state), read_json(path, LearnedFile)
    _validate(path, file, controller, max_age)
    found = file.numbers
    ratio = np.sqrt(law.gain / np.array(found.gain))
    rows, columns = np.triu_indices(len(ratio))
    memory, estimate = state.law_state, np.array(found.estimate)
    stored = memory.stored._replace(
        information=np.array(found.information) * ratio[rows] * ratio[columns], known=np.array(found.known) * ratio
    )
    watch = memory.watch._replace(trusted=estimate)
    tank: Any = state.controller_state
    if isinstance(tank, EnergyTank):
        tank = tank._replace(trusted=estimate, calm=np.zeros_like(tank.calm))
    learned = memory._replace(stored=stored, watch=watch)
    return state._replace(estimate=estimate, law_state=learned, controller_state=tank)


def _validate(path: str | Path, file: LearnedFile, controller: SlotineLi, max_age: float) -> None:
    model, age, numbers = controller.model, time.time() - file.saved_at, file.numbers
    if file.geometry_sha256 != model.mechanism.geometry_sha256:
        raise InputError(
            f"{path}: was learned by {file.mechanism!r}, whose geometry is another than that of "
            f"{model.mechanism.name!r}: start without it"
        )
    if file.parameters != list(model.names):
        others = ", ".join(sorted({*file.parameters} ^ {*model.names})[:3])
        raise InputError(
            f"{path}: was learned with other parameters ({others}): give the model the same, such as friction, or "
            "start without it"
        )
    k = len(model.names)
    sizes = [len(x) for x in (numbers.gain, numbers.estimate, numbers.known, numbers.information)]
    if not file.unchanged or sizes != [k, k, k, k * (k + 1) // 2]:
        raise InputError(f"{path}: the numbers were changed since they were saved: start without it")
    if not age <= real_number(max_age, "max_age in s"):
        raise InputError(f"{path}: was saved {age:.0f} s ago, and max_age is {max_age:g} s: start without it")
    if age < -CLOCK_ERROR:
        raise InputError(f"{path}: was saved {-age:.0f} s ahead of this machine's clock: set the clock")


def _law(controller: SlotineLi, state: AdaptiveState) -> GuardedLearning:
    law: Any = controller.adaptation_law
    if not isinstance(law, GuardedLearning):
        raise InputError(f"adaptation: expected GuardedLearning, whose information is kept, got {type(law).__name__}")
    if np.shape(state.estimate) != (k := len(controller.model.names),):
        raise InputError(f"state: expected that of one arm, estimates ({k},), got {np.shape(state.estimate)}")
    return law
