"""A custom experiment: `adaptctl experiment run my_experiment.py --duration 10`."""

from dataclasses import dataclass
from typing import ClassVar

from adaptctl.experiments.adaptive import AdaptiveTracking
from adaptctl.experiments.experiment import setting


@dataclass(frozen=True)
class MyExperiment(AdaptiveTracking):
    """`AdaptiveTracking` on an arm of my own."""

    name: ClassVar[str] = "my-experiment"
    title: ClassVar[str] = "{robot}: my own question"

    robot: str = setting("two_link", "my arm")

    @property
    def purpose(self) -> str:
        """The question, in a sentence."""
        return "How fast does my arm learn?"
