"""Adaptive controller of any arm, with everything chosen by rule."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from adaptctl.arrays import whole_number
from adaptctl.control import GuardedLearning, SlotineLi
from adaptctl.control.adaptation.late_torques import MAX_DELAY
from adaptctl.control.controller import Reference
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, TuningWarning, validate_kind, warn
from adaptctl.identifiability import ReducedModel, essential_space, fundamental_basis
from adaptctl.simulation.effects.actuators import ControlDelay
from adaptctl.simulation.effects.effect import Effect
from adaptctl.simulation.effects.plant_effects import listed
from adaptctl.tuning.default_gains import DEFAULT_SAMPLING_RATIO
from adaptctl.tuning.learning_rule import learning_by_rule
from adaptctl.tuning.tune import Tuning, tune


def adaptive_controller(
    mechanism: Mechanism,
    *,
    control_period: float = 1e-3,
    reference: Reference | None = None,
    sampling_ratio: float = DEFAULT_SAMPLING_RATIO,
    friction: bool = True,
    delay: int = 0,
    seed: int = 0,
    anyway: bool = False,
    effects: Iterable[Effect] = (),
) -> SlotineLi:
    """
    Return Slotine and Li's controller with the default learning law, from zero estimates.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism with r joints.
    control_period : float, default 0.001
        Time in s for which a torque is held. 1 kHz is the rate of most torque interfaces.
    reference : Reference, optional
        Trajectory for which the gains are chosen. Unless given, sinusoids within 60 % of the torque limits are drawn.
    sampling_ratio : float, default 0.5
        Bound of the damping, as in `tune`, which lowers it where torques act several control periods late.
    friction : bool, default True
        True to learn viscous and Coulomb friction of every primary joint: a real one has both, and a model without
        them explains friction by inertia.
    delay : int, default 0
        Control periods, 0 to 64, by which torques arrive late: what is learned is then of those that had arrived, and
        from two on gains are lower. The same as `ControlDelay(delay)` among the effects.
    seed : int, default 0
        Seed of all random choices. Fixed, so that a controller can be repeated.
    anyway : bool, default False
        True to accept gains that failed in simulation.
    effects : iterable of Effect, optional
        What the robot is known to have, such as encoders with few counts or elastic joints: `tune` lowers the gains
        until they hold with these. Default: none.

    Returns
    -------
    SlotineLi
        Controller with `GuardedLearning` on the base parameters; `controller.model` is its reduced model.

    Raises
    ------
    VerdictError
        If the arm does not learn with the tuned gains in the nominal simulation.
    InputError
        If a number is out of range, or no gains hold the arm at this period.

    Warns
    -----
    TuningWarning
        For each of the tuning's `notes`, such as a load near a torque limit.

    Notes
    -----
    Gains are those of `tune`, the law that of `learning_law`. docs/adaptation.md has the errors that it ends at.

    Examples
    --------
    >>> controller = adaptctl.adaptive_controller(arm, control_period=0.004)
    >>> controller
    <LeakyIntegral of 2 joints>
    >>> len(controller.model.names)  # with two friction parameters per joint
    10
    """
    if not isinstance(friction, bool):
        raise InputError(f"friction: expected True or False, got {friction!r}")
    validate_kind(mechanism, Mechanism, "adaptive_controller", "as load(...) gives one")
    mechanism = with_friction(mechanism) if friction else mechanism
    whole_number(delay, "delay in control periods", 0, MAX_DELAY)
    given: dict[str, Any] = {"control_period": control_period, "reference": reference, "sampling_ratio": sampling_ratio}
    late = (ControlDelay(delay),) if delay else ()
    tuning = tune(mechanism, **given, seed=seed, effects=(*listed(effects), *late), nominal_only=True)
    for note in tuning.notes:
        warn(f"{mechanism.name}: {note}", TuningWarning)
    model = ReducedModel(mechanism, fundamental_basis(essential_space(mechanism, seed=seed)))
    return tuning.controller(model, anyway=anyway)


def learning_law(model: ReducedModel, tuning: Tuning) -> GuardedLearning:
    """
    Return the default learning law for the gains of a tuning.

    Parameters
    ----------
    model : ReducedModel
        Reduced model with k parameters of the tuning's mechanism.
    tuning : Tuning
        Gains, torque limits and reference.

    Returns
    -------
    GuardedLearning
        Law whose gain is the diagonal of the tuning's, and whose weight is 1/(sigma^2 1 s): sigma of a joint is 0.3 %
        of its torque limit, or what 0.0033 rad/s makes by its damping, if that is less, but at least 3 % of the file's
        Coulomb friction. Its bound is at ten prior ranges, and an update may change torques by half of their limits.

    Raises
    ------
    InputError
        If the model is of another number of parameters.

    Examples
    --------
    >>> from adaptctl.tuning import learning_law
    >>> law = learning_law(model, adaptctl.tune(arm, control_period=0.004))
    >>> law.gain.shape, law.prediction_weight.shape
    ((6,), (2,))
    """
    gain, damping = tuning.adaptation_gain_for(model), tuning.gains.damping
    given = tuning.torque_limits, damping, tuning.control_period, tuning.reference
    return learning_by_rule(model, gain, *given, tuning.delay)


def with_friction(mechanism: Mechanism) -> Mechanism:
    """
    Return the mechanism with viscous and Coulomb friction of its primary joints as parameters.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism with r primary joints.

    Returns
    -------
    Mechanism
        Mechanism whose terms that the description does not have are 0.

    Examples
    --------
    >>> from adaptctl.tuning import with_friction
    >>> with_friction(arm).parameter_names[-4:]
    ('shoulder.viscous', 'elbow.viscous', 'shoulder.coulomb', 'elbow.coulomb')
    """
    primary = {joint.name for joint in mechanism.primary_joints}
    drives = [
        replace(drive, viscous=drive.viscous or 0.0, coulomb=drive.coulomb or 0.0) if name in primary else drive
        for name, drive in ((link.joint.name, link.joint.drive) for link in mechanism.links)
    ]
    return mechanism.with_drives(drives)
