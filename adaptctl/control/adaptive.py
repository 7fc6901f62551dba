"""Adaptive controllers and files of estimates."""

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
from adaptctl.files import hashed, read_json, write_json
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Tunable, absolute, clip, spread, where


class AdaptiveState(NamedTuple):
    """
    Internal state of an adaptive controller.

    Parameters
    ----------
    estimate : ndarray
        Estimate (..., k) in SI units.
    q : ndarray
        Positions (..., n) of the n joints of the spanning tree in the last period in rad (m).
    regressor_state : ndarray
        Numbers (..., m) in SI units, m depending on the mechanism and the law's delay, from which the regressors of the
        last period and of torques that have not arrived are computed.
    s : ndarray
        Sliding variable (..., r) in the last period in rad/s (m/s).
    torque : ndarray
        Torque (..., r) held over the last period in N m (N). If it is limited after the controller, put the applied
        torque here.
    dt : ndarray
        Time (..., 1) in s for which it is held; 0 if nothing is to be learned from the period.
    law_state : tuple
        Internal state of the adaptation law.
    controller_state : tuple
        Further internal state of the control law.

    Examples
    --------
    >>> state = law.init(p, v)
    >>> state.estimate.shape, state.q.shape
    ((6,), (2,))
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
        """Numbers of the adaptation law's state that a run records."""
        return self.law_state.logged_state


class AdaptiveController(Controller[AdaptiveState]):
    """
    Base class of controllers with any adaptation law.

    Notes
    -----
    A subclass is a frozen dataclass with these fields and `law`, calls `self._settle()` at construction, and returns in
    `_motion_size` the length of its regressor's state.

    Examples
    --------
    >>> controller = adaptctl.SlotineLi(model, 5.0, 4.0, adaptation=np.full(6, 0.1))  # a subclass
    >>> controller.adaptation_law.gain.shape, controller.init(p, v).estimate.shape
    ((6,), (6,))
    """

    model: ReducedModel
    adaptation: AdaptationLaw[Any] | Array | None
    initial: Array | None
    control_period: float
    torque_limits: ArrayLike | None

    def _settle(self) -> None:
        """Check and freeze the fields."""
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
        validate_kind(self.model, ReducedModel, type(self).__name__, "as ReducedModel(mechanism) is one")

    @cached_property
    def adaptation_law(self) -> AdaptationLaw[Any] | None:
        """Adaptation law, or None."""
        if self.adaptation is None or isinstance(self.adaptation, AdaptationLaw):
            return self.adaptation
        return Gradient(self.adaptation)

    @property
    def tunable_parts(self) -> Mapping[str, Tunable]:
        """Adaptation law by the name "adaptation", if there is one."""
        return {} if self.adaptation_law is None else {"adaptation": self.adaptation_law}

    @property
    def dof(self) -> int:
        """Number r of primary joints."""
        return self.model.mechanism.dof

    @property
    def neutral_configuration(self) -> Array:
        """Neutral positions (r,) in rad (m)."""
        return self.model.mechanism.neutral_configuration

    def initial_state(self, p: Array, v: Array) -> AdaptiveState:
        """
        Return the initial estimate with zero torque and time.

        Parameters
        ----------
        p, v : ndarray
            Positions (..., r) in rad (m) and velocities (..., r) in rad/s (m/s).

        Returns
        -------
        AdaptiveState
            Internal state before the first control period.

        Raises
        ------
        InputError
            If p has a wrong shape.
        NonFiniteError
            If p is not finite.
        SingularityError
            If p is near a singularity of the kinematic loops.
        """
        rest, initial = np.zeros(self.dof), np.array(self.initial)
        q, law = self.model.mechanism.configuration(p), self.adaptation_law
        motion = np.zeros(self._motion_size * (1 + (law.regressor_delay if law else 0)))
        learning = NoMemory() if law is None else law.initial_state(self.model, initial, q, v, self.control_period)
        return AdaptiveState(initial, q, motion, rest, rest, np.zeros(1), learning, self._controller_state(p, v))

    @property
    @abstractmethod
    def _motion_size(self) -> int:
        """Length of a regressor's state."""

    def _controller_state(self, p: Array, v: Array) -> Any:
        """Further initial state of the control law."""
        return NoMemory()

    def _adapted(self, memory: AdaptiveState, passed: Period) -> tuple[Column, Any]:
        """Next estimate (k,) and state of the adaptation law."""
        if self.adaptation_law is None:
            return memory.estimate, memory.law_state
        return self.adaptation_law.law(self.model, memory.estimate, passed, memory.law_state)

    def _settle_torque_limits(self) -> None:
        object.__setattr__(self, "torque_limits", torque_limits(self.model.mechanism, self.torque_limits))

    def _limited(self, torque: Column) -> tuple[Column, Column]:
        """Limited torque (r,), and learning time, 0 if limited."""
        kept, length = [], self.control_period
        for x, limit in zip(torque, np.asarray(self.torque_limits).tolist(), strict=True):
            bounded = clip(x, -limit, limit) if np.isfinite(limit) else x
            length = where(absolute(x) <= limit, length, 0.0) if np.isfinite(limit) else length
            kept.append(bounded)
        return Column(kept), Column((length,))

    def _parameters(self, estimate: Column) -> Column:
        return spread(estimate, self.model.columns, self.model.mechanism.equations.parameters)


class _Saved(msgspec.Struct, forbid_unknown_fields=True):
    schema: Literal["adaptctl/estimate/2"]
    mechanism: str
    geometry_sha256: str
    parameters: dict[str, float]
    sha256: str


def save_estimate(path: str | Path, model: ReducedModel, estimate: ArrayLike) -> None:
    """
    Write an estimate to a JSON file, by parameter name, with hashes of the mechanism's geometry and of the numbers.

    Parameters
    ----------
    path : str or Path
        Path of the file, which is replaced if it exists.
    model : ReducedModel
        Reduced model with k parameters.
    estimate : array_like
        Estimate (k,) in SI units.

    Raises
    ------
    InputError
        If the estimate has a wrong shape or is not finite.
    FileError
        If the file cannot be written.

    Examples
    --------
    >>> adaptctl.control.save_estimate(tmp / "estimate.json", model, np.arange(6.0))
    >>> adaptctl.control.load_estimate(tmp / "estimate.json", model)
    array([0., 1., 2., 3., 4., 5.])
    """
    _validate_path(path)
    values = frozen_array(estimate, (len(model.names),), "estimate")
    parameters = dict(zip(model.names, values.tolist(), strict=True))
    mechanism = model.mechanism
    write_json(
        path, _Saved("adaptctl/estimate/2", mechanism.name, mechanism.geometry_sha256, parameters, hashed(parameters))
    )


def load_estimate(path: str | Path, model: ReducedModel) -> Array:
    """
    Read an estimate that `save_estimate` wrote.

    Parameters
    ----------
    path : str or Path
        Path of the file.
    model : ReducedModel
        Reduced model with k parameters.

    Returns
    -------
    ndarray
        Estimate (k,) in SI units, in the order of the model's parameters.

    Raises
    ------
    FileError
        If the file cannot be read, is no estimate, is of another geometry, has other parameters than the model, or was
        edited; the message has the line that accepts it. The mechanism's name is not compared.

    Examples
    --------
    >>> adaptctl.control.save_estimate(tmp / "estimate.json", model, np.zeros(6))
    >>> adaptctl.control.load_estimate(tmp / "estimate.json", model).shape
    (6,)
    """
    _validate_path(path)
    content = read_json(path, _Saved)
    saved = content.parameters
    missing = [name for name in model.names if name not in saved]
    foreign = [name for name in saved if name not in model.names]
    if missing or foreign:
        wrong = f"{missing[0]!r} is missing" if missing else f"{foreign[0]!r} is not one of them"
        raise FileError(f"{path}: expected the {len(model.names)} parameters of {model.mechanism.name}: {wrong}")
    _validate_own(path, content, model)
    return np.array([saved[name] for name in model.names])


def _validate_own(path: str | Path, content: _Saved, model: ReducedModel) -> None:
    """Raise `FileError` if an estimate is of another geometry, or was edited."""
    geometry, numbers = model.mechanism.geometry_sha256, hashed(content.parameters)
    if content.geometry_sha256 != geometry:
        raise FileError(
            f"{path}: estimate of {content.mechanism!r}, whose geometry, gravity or names are other than those of "
            f'{model.mechanism.name!r}: its numbers mean something else; to accept them, write "geometry_sha256": '
            f'"{geometry}"'
        )
    if content.sha256 != numbers:
        raise FileError(f'{path}: the parameters were changed; to accept them, write "sha256": "{numbers}"')


def _validate_path(path: object) -> None:
    if not isinstance(path, str | os.PathLike) or "\0" in str(path):
        raise FileError(f"path: expected the path of a file, got {printable(repr(path))}")
