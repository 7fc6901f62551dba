"""Ctrl-C between the arms or plants of an experiment: what was run is kept."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from adaptctl.experiments.counterweight import CounterweightedTracking
from adaptctl.experiments.two_plants import TwoPlants
from adaptctl.recording import shown
from adaptctl.recording.result import silent

ARM = str(Path(__file__).parents[1] / "docs" / "examples" / "two_link.toml")


def until(label: str) -> Callable[[str, float], None]:
    """Progress that is interrupted before the first sample of the run with this label."""

    def interrupted(what: str, share: float) -> None:
        if what == label:
            raise KeyboardInterrupt

    return interrupted


def test_the_arm_as_described_is_kept_when_the_balanced_one_is_interrupted(tmp_path: Path) -> None:
    experiment = CounterweightedTracking(robot=ARM, duration=0.5, samples=50, components=3)
    result = experiment.run(until("All adapted, with counterweights"))
    assert not result.complete
    result.write(tmp_path, silent)
    content = json.loads((tmp_path / "summary.json").read_text())
    assert set(content["runs"]) == {"all-before", "few-before", "held-before"}
    assert not content["complete"]
    with pytest.raises(KeyboardInterrupt):
        experiment.run(until("All adapted, as described"))


def test_what_no_run_answers_is_not_asked() -> None:
    experiment = CounterweightedTracking(robot=ARM, duration=0.5, samples=50, components=3)
    facts = experiment.run(until("3 adapted, as described")).facts
    assert facts
    assert all(fact.answer.strip(" %J→") for fact in facts)


@pytest.mark.parametrize("label", ["Slotine-Li on MuJoCo, steps 4 times shorter", "Slotine-Li on adaptctl's plant"])
def test_the_first_plant_is_kept_when_another_is_interrupted(label: str, tmp_path: Path) -> None:
    experiment = TwoPlants(robot=ARM, duration=2.0)
    comparison = experiment.compare(until(label))
    names = [run.name for run in comparison.runs]
    assert names == ["adaptive", "adaptation-off", "mujoco-fine"][: len(names)]
    assert len(names) == (2 if "MuJoCo" in label else 3)
    assert not comparison.complete
    shown(comparison).write(tmp_path, silent)
    assert not json.loads((tmp_path / "summary.json").read_text())["complete"]
    with pytest.raises(KeyboardInterrupt):
        experiment.compare(until("Slotine-Li on MuJoCo"))
