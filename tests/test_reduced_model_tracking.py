"""The experiment that carries the paper's Table 3 over to adaptive control."""

from __future__ import annotations

from typing import Any

import pytest
from comparisons import shown
from nightly import nightly

from adaptctl.errors import InputError
from adaptctl.experiments.puma560_adaptive import Puma560Adaptive

COUNTS = (36, 30, 10)

pytestmark = pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning")


@pytest.fixture(scope="module")
def said() -> dict[str, Any]:
    return shown(Puma560Adaptive(duration=6.0, components=COUNTS))


@nightly
def test_every_count_runs_adapted_and_held(said: dict[str, Any]) -> None:
    wanted = (*(f"adaptive-{s}" for s in COUNTS), *(f"fixed-{s}" for s in COUNTS), "adaptation-off")
    assert tuple(said["runs"]) == wanted


def test_fewer_components_carry_less_energy_and_track_worse(said: dict[str, Any]) -> None:
    energies = [said["findings"][f"energy_error.{s}"]["value"] for s in COUNTS]
    assert energies[0] == 0.0
    assert 0.5 < energies[1] < 10.0 < energies[2] < 60.0
    for kind in ("adaptive", "fixed"):
        errors = [said["runs"][f"{kind}-{s}"]["final_rms_error"] for s in COUNTS]
        assert errors == sorted(errors)


def test_ten_numbers_that_adapt_do_better_than_ten_true_ones(said: dict[str, Any]) -> None:
    final = {name: run["final_rms_error"] for name, run in said["runs"].items()}
    for s in (30, 10):
        assert final[f"adaptive-{s}"] < 0.7 * final[f"fixed-{s}"]
    assert final["fixed-36"] < 1e-5
    assert all(final[f"adaptive-{s}"] < 0.6 * final["adaptation-off"] for s in COUNTS)


def test_only_what_is_whole_leaves_the_proof_as_it_is(said: dict[str, Any]) -> None:
    """V never rises with all 36; what 10 leave out is a disturbance."""
    assert said["runs"]["adaptive-36"]["lyapunov_max_increase"] == 0.0
    assert said["runs"]["adaptive-10"]["lyapunov_max_increase"] > 0.0


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"components": (37,)}, "has 36 essential parameters, got 37"),
        ({"components": (10, 10)}, "expected unique numbers"),
        ({"robot": "puma560_friction"}, "has friction, which has no energy components"),
    ],
)
def test_what_cannot_be_is_refused(options: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        Puma560Adaptive(duration=0.1, **{"components": (30,)} | options).compare(lambda what, share: None)
