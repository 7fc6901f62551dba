"""Single precision: lanes of twice as many arms, as far from double as 7 digits let expect, refused where it is not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from every_law import LAWS
from nightly import at_night
from sampled_loops import arm, gains, own_gain, reduced, swinging
from test_export import write_scaled

import adaptctl
from adaptctl.arrays import Array
from adaptctl.compilation import Stepper, compile_step
from adaptctl.compilation.lanes import Lanes, single
from adaptctl.compilation.native import Processor
from adaptctl.compilation.sine import SINGLE
from adaptctl.control import ComputedTorque, Gradient, SlotineLi
from adaptctl.errors import InputError
from adaptctl.scalars import Column, cos, sin
from adaptctl.simulation import Plant, Rollouts, simulate_many
from adaptctl.simulation.members import MAX_FLOAT32_PERIODS
from adaptctl.sweeps.rows import rows_of
from adaptctl.sweeps.study import SweepStudy

pytestmark = pytest.mark.usefixtures("optimized")

PUMA, SMALL, LOOP = "puma560_measured", "puma560_arm3", "semi_direct_drive"
WIDTHS = (1, 2, 4, 8, 16)


def turning(lanes: int) -> Stepper:
    def both(x: Column) -> tuple[float, float]:
        return sin(x[0]), cos(x[0])

    return compile_step(both, state={}, constants={"x": 1}, lanes=lanes, precision="single")


@pytest.mark.parametrize("lanes", WIDTHS)
def test_sines_are_within_two_units_in_the_last_place_of_one(lanes: int) -> None:
    """Close to multiples of a quarter turn they have fewer digits than in double, so absolute errors are promised."""
    rng = np.random.default_rng(0)
    quarters = 0.5 * np.pi * np.arange(-5000.0, 5000.0)
    angles = np.concatenate([rng.uniform(-SINGLE.farthest, SINGLE.farthest, 5000), quarters, rng.uniform(-7, 7, 5000)])
    angles = angles.astype(np.float32).astype(np.float64)
    ensemble = turning(lanes).ensemble(len(angles))
    ensemble.held["x"] = angles[:, None]
    for found, true in zip(ensemble.run(), (np.sin(angles), np.cos(angles)), strict=True):
        assert np.abs(found.ravel() - true).max() < 2.0 * np.spacing(np.float32(0.5))


def test_farther_angles_are_the_c_librarys_and_what_is_not_finite_has_no_sine() -> None:
    ensemble = turning(8).ensemble(4)
    ensemble.held["x"] = np.array([1e5, np.inf, np.nan, 0.5])[:, None]
    sines, _ = ensemble.run()
    assert sines[[0, 3]].ravel() == pytest.approx(np.sin([1e5, 0.5]), rel=2e-7)
    assert np.isnan(sines[1:3]).all()


@pytest.mark.parametrize("x", [1e-300, -1e-300, 1e300, -1e300])
def test_constants_stay_finite_and_do_not_vanish(x: float) -> None:
    """Guards against division by zero and bounds that are out of reach mean the same in both precisions."""
    assert np.isfinite(np.float32(single(x)))
    assert np.sign(np.float32(single(x))) == np.sign(x)
    (found,) = (
        compile_step(lambda n: (n[0] * 0.0 + x,), state={}, constants={"n": 1}, precision="single").ensemble(1).run()
    )
    assert found == single(x)


def runs(name: str, steps: int, **more: Any) -> Rollouts:
    mechanism, model = arm(name), reduced(name)
    first = 1.2 * model.fundamental_parameters
    law = SlotineLi(model, 8.0, gains(name).damping, own_gain(name), first)
    references = [swinging(mechanism, seed=k, amplitude=0.3) for k in range(9)]
    true = mechanism.inertial_parameters * np.linspace(0.95, 1.05, 9)[:, None]
    return simulate_many(Plant(mechanism, 1e-3), law, references, duration=1e-3 * steps, parameters=true, **more)


@pytest.mark.parametrize("name", [PUMA, LOOP])
def test_loops_are_those_of_double_to_seven_digits(name: str) -> None:
    for steps, apart in ((100, 2e-6), (3000, 2e-5)):
        double, found = runs(name, steps), runs(name, steps, precision="single")
        assert 0.0 < np.abs(found.p - double.p).max() < apart
        np.testing.assert_allclose(found.rms_error, double.rms_error, rtol=1e-2, atol=apart)
    assert np.isnan(found.lyapunov_rise).all()  # its rises would be those of round-off
    assert not np.isnan(double.lyapunov_rise).any()


def test_lanes_are_as_many_as_fit_a_register() -> None:
    for feature in ("sse2", "avx", "avx512f"):
        processor = Processor("x86-64", f"+{feature}")
        assert processor.lanes_of("single") == 2 * processor.lanes_of("double")
    assert Processor("generic", "").lanes_of("single") == 1


def rocking(x: Column, u: Column) -> tuple[Column, Column]:
    after = x + 0.01 * Column((x[1], u[0] - sin(x[0])))
    return after, Column((cos(after[0]),))


@pytest.mark.parametrize("lanes", WIDTHS)
def test_lanes_are_one_by_one_bit_for_bit(lanes: int) -> None:
    found: list[Array] = []
    for count in (1, lanes):
        step = compile_step(rocking, state={"x": 2}, per_member_inputs={"u": 1}, lanes=count, precision="single")
        ensemble = step.ensemble(21)
        ensemble.state["x"] = np.random.default_rng(0).normal(size=(21, 2))
        (cosines,) = ensemble.run(50, {"u": np.random.default_rng(1).normal(size=(50, 21, 1))}, record=True)
        found += [cosines, ensemble.state["x"]]
    np.testing.assert_array_equal(found[0], found[2])
    np.testing.assert_array_equal(found[1], found[3])
    assert found[0].dtype == np.float64
    assert step.dtype == np.float32


@pytest.mark.parametrize("kind", ["forgetting", at_night("composite learning")])
def test_matrices_that_forget_are_refused_also_within_a_guard(kind: str) -> None:
    law: Any = LAWS[kind]
    guard = adaptctl.control.SafetyFilter(law, np.full(law.dof, 50.0), np.full(law.dof, 1e4))
    plant = Plant(law.model.mechanism, 1e-3)
    for one in (law, guard):
        with pytest.raises(InputError, match=r"precision: .* the forgetting of \w+: use double"):
            simulate_many(plant, one, swinging(law.model.mechanism), duration=0.01, precision="single")
        assert simulate_many(plant, one, swinging(law.model.mechanism), duration=0.01).finite.all()


def test_what_single_precision_cannot_do_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"precision: expected one of double, single, got 'half'"):
        Lanes(4, "half")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="lanes: expected 1, 2, 4 or 8"):
        Lanes(16)
    far = adaptctl.load(write_scaled(tmp_path, 1e4))
    law = ComputedTorque(far, 8.0)
    with pytest.raises(InputError, match=r"precision: in single precision the loops .* stay open by .*; use double"):
        simulate_many(Plant(far, 1e-3), law, swinging(far), duration=0.01, precision="single")
    small = arm("puma560_arm3")
    with pytest.raises(
        InputError, match=f"counts to {MAX_FLOAT32_PERIODS} control periods, got {MAX_FLOAT32_PERIODS + 1}"
    ):
        simulate_many(
            Plant(small, 1e-3), ComputedTorque(small, 8.0), swinging(small),
            duration=1e-3 * (MAX_FLOAT32_PERIODS + 1), record_every=None, precision="single",
        )  # fmt: skip
    with pytest.raises(InputError, match="precision"):
        gymnasium.make_vec("adaptctl.envs:adaptctl/Puma560Tracking-v0", num_envs=2, precision="half")


def test_environments_are_those_of_double_to_seven_digits() -> None:
    make = lambda precision: gymnasium.make_vec(  # noqa: E731
        "adaptctl.envs:adaptctl/Puma560Tracking-v0", num_envs=5, precision=precision
    )
    ours, theirs = make("single"), make("double")
    told, _ = ours.reset(seed=1)
    expected, _ = theirs.reset(seed=1)
    np.testing.assert_allclose(told, expected, atol=1e-6)
    for k in range(100):
        torque = 5.0 * np.sin(0.1 * k + np.arange(30.0).reshape(5, 6))
        told, reward, *_ = ours.step(torque)
        expected, usual, *_ = theirs.step(torque)
    p = theirs.unwrapped.observation_slices["p"]  # type: ignore[attr-defined]
    assert 0.0 < np.abs(told[:, p] - expected[:, p]).max() < 5e-6
    np.testing.assert_allclose(reward, usual, rtol=1e-4)


def test_a_whole_gain_learns_alike() -> None:
    """Gamma (k, k) is multiplied, never inverted, while it learns."""
    model = reduced(SMALL)
    k, plant = len(model.names), Plant(arm(SMALL), 1e-3)
    mixed = np.linalg.qr(np.random.default_rng(k).normal(size=(k, k)))[0]
    gain = mixed @ np.diag(np.linspace(0.5, 1.0, k) * 0.05) @ mixed.T
    law = SlotineLi(model, 8.0, gains(SMALL).damping, Gradient(gain))
    double, found = (
        simulate_many(plant, law, swinging(arm(SMALL)), duration=1.0, precision=precision)  # type: ignore[arg-type]
        for precision in ("double", "single")
    )
    np.testing.assert_allclose(found.estimate, double.estimate, atol=1e-4 * np.abs(double.estimate).max())


class TestSweeps:
    """Sweeps whose runs are computed together in single precision."""

    RUNS: tuple[dict[str, Any], ...] = ({"duration": 2.5, "bandwidth": 6.0}, {"duration": 2.5, "bandwidth": 8.0})

    def test_rows_are_those_of_double_to_digits_that_matter(self) -> None:
        double, found = (rows_of("puma560-adaptive", self.RUNS, ("adaptive",), each) for each in ("double", "single"))
        for one, usual in zip(found, double, strict=True):
            assert one["final_rms_error"] == pytest.approx(usual["final_rms_error"], rel=1e-3)
            assert one["status"] == "done"

    def test_a_study_says_its_precision(self) -> None:
        usual = SweepStudy.named("puma560-adaptive", {"bandwidth": "4,8"})
        assert usual.precision == "double"
        assert replace(usual, precision="single").sha256 != usual.sha256

    def test_what_is_typed_replaces_what_the_file_says(self, tmp_path: Path) -> None:
        path = tmp_path / "mine.toml"
        path.write_text('schema = "adaptctl/study/2"\nexperiment = "puma560-adaptive"\nprecision = "single"\n')
        assert SweepStudy.named(str(path), {}).precision == "single"
        assert SweepStudy.named(str(path), {}, precision=None).precision == "single"
        assert SweepStudy.named(str(path), {}, precision="double").precision == "double"
