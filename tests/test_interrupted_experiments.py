"""Ctrl-C between the arms or plants of an experiment: what was run is kept."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from nightly import at_night

from adaptctl.experiments.adaptive import AdaptiveTracking
from adaptctl.recording import shown
from adaptctl.recording.result import silent

ARM = "two_link"


def until(label: str) -> Callable[[str, float], None]:
    """Progress that is interrupted before the first sample of the run with this label."""

    def interrupted(what: str, share: float) -> None:
        if what == label:
            raise KeyboardInterrupt

    return interrupted


@pytest.mark.parametrize(
    "label", ["Learning on MuJoCo, steps 4 times shorter", at_night("Learning on the built-in plant")]
)
def test_the_first_plant_is_kept_when_another_is_interrupted(label: str, tmp_path: Path) -> None:
    experiment = AdaptiveTracking(robot=ARM, plant="both", duration=2.0)
    comparison = experiment.compare(until(label))
    names = [run.name for run in comparison.runs]
    assert names == ["learning", "adaptation-off", "mujoco-fine"][: len(names)]
    assert len(names) == (2 if "MuJoCo" in label else 3)
    assert not comparison.complete
    shown(comparison).write(tmp_path, silent)
    assert not json.loads((tmp_path / "summary.json").read_text())["complete"]
    with pytest.raises(KeyboardInterrupt):
        experiment.compare(until("Learning on MuJoCo"))
