"""Computed torque: exact with the true parameters, and only with them."""

from __future__ import annotations

import numpy as np
import pytest

from adaptctl.control import ComputedTorque, ReferencePoint
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import InputError


@pytest.fixture(scope="module")
def puma() -> Mechanism:
    return load("puma560_measured")


def error_acceleration(puma: Mechanism, law: ComputedTorque) -> tuple[np.ndarray, np.ndarray]:
    """e'' that follows from the torque, and e'' that the error loop asks for."""
    rng = np.random.default_rng(1)
    p, v, pd, vd, ad = 0.3 * rng.normal(size=(5, 6))
    torque, _ = law.step(law.init(p, v), p, v, ReferencePoint(pd, vd, ad))
    wanted = -2.0 * law.damping_ratio * law.bandwidth * (v - vd) - law.bandwidth**2 * (p - pd)
    return puma.forward_dynamics(p, v, torque) - ad, wanted


def test_true_parameters_make_the_error_linear(puma: Mechanism) -> None:
    got, wanted = error_acceleration(puma, ComputedTorque(puma, 20.0, damping_ratio=0.7))
    np.testing.assert_allclose(got, wanted, rtol=1e-9)


def test_wrong_parameters_do_not(puma: Mechanism) -> None:
    wrong = 0.5 * puma.inertial_parameters
    got, wanted = error_acceleration(puma, ComputedTorque(puma, 20.0, parameters=wrong))
    assert np.abs(got - wanted).max() > 1.0


def test_one_bandwidth_a_joint(puma: Mechanism) -> None:
    got, wanted = error_acceleration(puma, ComputedTorque(puma, np.linspace(5.0, 20.0, 6)))
    np.testing.assert_allclose(got, wanted, rtol=1e-9)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"bandwidth": -1.0}, "bandwidth: expected positive"),
        ({"bandwidth": np.ones(5)}, r"bandwidth: expected a number or 6 of them, got shape \(5,\)"),
        ({"bandwidth": 5.0, "damping_ratio": np.inf}, "damping ratio"),
        ({"bandwidth": 5.0, "parameters": np.zeros(36)}, r"parameters: expected shape \(60,\), got \(36,\)"),
    ],
)
def test_bad_settings_are_refused(puma: Mechanism, options: dict[str, object], says: str) -> None:
    with pytest.raises(InputError, match=says):
        ComputedTorque(puma, **options)  # type: ignore[arg-type]
