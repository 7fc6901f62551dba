"""Control laws that adapt: their estimate, and the period it learns from."""

from __future__ import annotations

import os
from abc import abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, NamedTuple

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array
from adaptctl.caching import cached_property
from adaptctl.control.adaptation.gradient import Gradient
from adaptctl.control.adaptation.law import AdaptationLaw, NoMemory, Period
from adaptctl.control.controller import Controller
from adaptctl.control.gains.gains import torque_limits
from adaptctl.control.gains.sampling_ratio import validate_period
from adaptctl.errors import FileError, printable, validate_kind
from adaptctl.files import read_json, write_json
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Tunable, absolute, clip, spread, where


class AdaptiveState(NamedTuple):
    """Internal state of an adaptive control law: its parameter estimate, and data of the last control period, from
    which it learns in the next.

    Columns, each with leading axes where there are many arms: `estimate` (k,) of the k parameters, SI units; `q` (n,),
    positions of the spanning tree's n joints in the last control period, rad (m for a prismatic joint), from which
    kinematic loops, if any, are followed; `motion` (w,), w numbers in SI units of the motion then, as many as the
    control law needs to make the gradient Y_r' s, Y_r' the transpose of the torque regressor Y_r (r, k) then; `s` (r,),
    the sliding variable of r joints then, velocity less reference velocity, rad/s (m/s); `torque` (r,), N m (N), held
    since; `elapsed` (1,), the time since in s, 0 before the first control period. `learning` is the adaptation law's
    internal state, `more` what the control law itself keeps besides, named tuples of columns. Nothing is checked.

    If the torque is limited after the controller, put the applied torque into `torque`, and zero into `elapsed` for a
    period that is not to be learned from.
    """

    estimate: Any
    q: Any
    regressor_state: Any
    s: Any
    torque: Any
    dt: Any
    law_state: Any
    controller_state: Any

    @property
    def logged_state(self) -> Any:
        """Array of the adaptation law's internal state that is stored with each sample of a recorded run. For
        `ConcurrentLearning`, (..., 1): 1 where a sample was put on its stack, else 0. For `CompositeLearning`, (...,
        1): the number, 0 to r, of the r joints whose torque equation was learned from. For `ConsistentAdaptation`,
        (..., P): the P inertial and friction parameters, SI units, whose fundamental (base) parameters are the
        estimate. Raises `AttributeError` for other laws, or with adaptation off."""
        return self.law_state.logged_state


class AdaptiveController(Controller[AdaptiveState]):
    """Base class of adaptive controllers: a control law for r joints on a model's k parameters, combined with any
    adaptation law.

    A subclass is a frozen dataclass of the fields below. It writes the method `law(p, v, reference, memory)`, which
    returns the torque (r,) and the `AdaptiveState` after it, and the property `_motion_size`, how many numbers of a
    control period's motion that state keeps, and calls `self._settle()`, which checks the fields, at construction.

    `model` is the mechanism's model in these parameters; `adaptation` is an adaptation law, or a gain Gamma for
    `Gradient`, its diagonal (k,) or whole (k, k), in units of the parameters squared per J, or None to switch
    adaptation off; `initial` (k,) is the initial estimate in SI units, None for zero; `period` is the control period
    T_c in s. Nothing is learned from a period whose torque is beyond `torque_limits`, one number or (r,), N m (N for a
    prismatic joint), None for the mechanism's own. Raises `InputError` for a period or torque limits that are not
    positive, an initial estimate that is not finite, another shape of either, a gain that is not positive definite, and
    a gain or law that does not fit the model.
    """

    model: ReducedModel
    adaptation: AdaptationLaw[Any] | Array | None
    initial: Array | None
    control_period: float
    torque_limits: ArrayLike | None

    def _settle(self) -> None:
        """Check the period, the initial estimate and the adaptation law, and freeze them."""
        self._validate_model()
        k = len(self.model.columns)
        validate_period(self.control_period)
        self._settle_torque_limits()
        initial = np.zeros(k) if self.initial is None else self.initial
        object.__setattr__(self, "initial", frozen_array(initial, (k,), "initial estimate"))
        if self.adaptation_law is None:
            return
        if not isinstance(self.adaptation, AdaptationLaw):
            object.__setattr__(self, "adaptation", self.adaptation_law.gain)  # type: ignore[attr-defined]  # a gain was given
        self.adaptation_law.validate(self.model, np.asarray(self.initial), self.control_period)

    def _validate_model(self) -> None:
        """Raise `InputError` for what is no model, such as a mechanism."""
        validate_kind(self.model, ReducedModel, type(self).__name__, "as ReducedModel(mechanism, basis) is one")

    @cached_property
    def adaptation_law(self) -> AdaptationLaw[Any] | None:
        """The controller's adaptation law: that given as the attribute `adaptation`, or a `Gradient` with its defaults
        where only a gain was given; None with adaptation off."""
        if self.adaptation is None or isinstance(self.adaptation, AdaptationLaw):
            return self.adaptation
        return Gradient(self.adaptation)

    @property
    def tunable_parts(self) -> Mapping[str, Tunable]:
        """Mapping with the controller's adaptation law under the key "adaptation", also where only a gain was given;
        empty with adaptation off. The law is the one attribute with tunable numbers of its own, which are arguments of
        the controller's native code, so that other values need no new code."""
        return {} if self.adaptation_law is None else {"adaptation": self.adaptation_law}

    @property
    def dof(self) -> int:
        """Number r of the mechanism's primary (independent) joints; kinematic loops, if any, move the others."""
        return self.model.mechanism.dof

    @property
    def neutral_configuration(self) -> Array:
        """Positions (r,) of the r primary (independent) joints, in rad (m for a prismatic joint), at the mechanism's
        home configuration, where its kinematic loops are known to close; zeros without loops."""
        return self.model.mechanism.neutral_configuration

    def initial_state(self, p: Array, v: Array) -> AdaptiveState:
        """The internal state before the first control period, an `AdaptiveState`: the initial estimate, zero torque,
        and 0 s as the time since the last period, so that nothing is learned from it. Arms are at positions p in rad (m
        for a prismatic joint) and velocities v in rad/s (m/s), (..., r) for r primary (independent) joints; v is for
        adaptation laws that filter motions, and not checked. Raises `InputError` on a wrong shape of p,
        `NonFiniteError` on NaN or infinity in it, `SingularityError` near a singularity of the kinematic loops."""
        rest, initial = np.zeros(self.dof), np.array(self.initial)
        motion = np.zeros(self._motion_size)
        q, law = self.model.mechanism.configuration(p), self.adaptation_law
        learning = NoMemory() if law is None else law.initial_state(self.model, initial, q, v, self.control_period)
        return AdaptiveState(initial, q, motion, rest, rest, np.zeros(1), learning, self._more(p, v))

    @property
    @abstractmethod
    def _motion_size(self) -> int:
        """Number of a motion's numbers that the law remembers."""

    def _more(self, p: Array, v: Array) -> Any:
        """The control law's own memory besides, before the first tick."""
        return NoMemory()

    def _learned(self, memory: AdaptiveState, passed: Period) -> tuple[Column, Any]:
        """The estimate (k,) after the period that has passed, and the adaptation law's internal state."""
        if self.adaptation_law is None:
            return memory.estimate, memory.law_state
        return self.adaptation_law.law(self.model, memory.estimate, passed, memory.law_state)

    def _settle_torque_limits(self) -> None:
        """Check the torque limits, the mechanism's own unless given, and freeze them."""
        object.__setattr__(self, "torque_limits", torque_limits(self.model.mechanism, self.torque_limits))

    def _held(self, torque: Column) -> tuple[Column, Column]:
        """The torque (r,) that the limits let through, and the time to learn from it: none while it is clipped, when
        the error is not the estimate's fault."""
        kept, length = [], self.control_period
        for x, limit in zip(torque, np.asarray(self.torque_limits).tolist(), strict=True):
            bounded = clip(x, -limit, limit) if np.isfinite(limit) else x
            length = where(absolute(x) <= limit, length, 0.0) if np.isfinite(limit) else length
            kept.append(bounded)
        return Column(kept), Column((length,))

    def _parameters(self, estimate: Column) -> Column:
        """The P parameters of the mechanism that an estimate stands for."""
        return spread(estimate, self.model.columns, self.model.mechanism.equations.parameters)


SCHEMA = "adaptctl/estimate/1"


class _Saved(msgspec.Struct, forbid_unknown_fields=True):
    schema: Literal["adaptctl/estimate/1"]
    mechanism: str
    parameters: dict[str, float]


def save_estimate(path: str | Path, model: ReducedModel, estimate: ArrayLike) -> None:
    """Write an `estimate` (k,) of the `model`'s k parameters, in their SI units, as a JSON file at `path`, each number
    under its parameter's name. A file that exists is replaced.

    Raises `InputError` for an estimate of a wrong shape or not finite, `FileError` for a `path` that is no path of a
    file, and where the file cannot be written.
    """
    _validate_path(path)
    values = frozen_array(estimate, (len(model.names),), "estimate")
    parameters = dict(zip(model.names, values.tolist(), strict=True))
    write_json(path, {"schema": SCHEMA, "mechanism": model.mechanism.name, "parameters": parameters})


def load_estimate(path: str | Path, model: ReducedModel) -> Array:
    """The estimate (k,), in SI units, that `save_estimate` wrote at `path`, in the order of the `model`'s k parameters,
    whatever their order in the file.

    Raises `FileError` for a `path` that is no path of a file, and for a file that cannot be read, is no such estimate,
    has a number that is not finite, or has names of parameters other than the model's. The mechanism's name in the file
    is not compared.
    """
    _validate_path(path)
    saved = read_json(path, _Saved).parameters
    missing = [name for name in model.names if name not in saved]
    foreign = [name for name in saved if name not in model.names]
    if missing or foreign:
        wrong = f"{missing[0]!r} is missing" if missing else f"{foreign[0]!r} is not among them"
        raise FileError(f"{path}: the parameters are not the {len(model.names)} of {model.mechanism.name}: {wrong}")
    return np.array([saved[name] for name in model.names])


def _validate_path(path: object) -> None:
    if not isinstance(path, str | os.PathLike) or "\0" in str(path):
        raise FileError(f"path: expected the path of a file, got {printable(repr(path))}")
