"""Learners by the recipes of the documentation, against the controllers they are to beat: `make check-learners`.

Each recipe runs as it is documented, in a process of its own that says what it reached; its processor time is told.
Names each tool that is missing, and what is not tried for it.
"""

from __future__ import annotations

import importlib.util
import os
import re
import resource
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
EXAMPLES = ROOT / "docs" / "examples"
INSTALL = {"torch": "torch", "stable_baselines3": "stable-baselines3"}
MOST = 1200.0
"""s of processor time, ten minutes of two cores"""


@dataclass(frozen=True)
class Recipe:
    """An example's command, what it needs, and which of the returns that it tells has to be above which."""

    arguments: tuple[str, ...]
    needs: tuple[str, ...]
    learner: str
    beaten: str

    def missing(self) -> list[str]:
        """What would have to be installed."""
        return [INSTALL[name] for name in self.needs if importlib.util.find_spec(name) is None]


SB3 = "torch", "stable_baselines3"
RECIPES = {
    "ppo": Recipe(("ppo.py",), ("torch",), "PPO", "PD with gravity"),
    "residual": Recipe(("ppo.py", "--task", "residual"), ("torch",), "PPO", "no action"),
    "tuning": Recipe(("ppo.py", "--task", "tuning"), ("torch",), "PPO", "no action"),
    "sac": Recipe(("sb3_learners.py", "--algorithm", "sac"), SB3, "SAC", "PD with gravity"),
    "sb3-ppo": Recipe(("sb3_learners.py", "--algorithm", "ppo"), SB3, "PPO", "PD with gravity"),
}


def returns_of(output: str) -> dict[str, float]:
    """The returns by name that an example ends with."""
    return {name: float(value) for name, value in re.findall(r"^(\S.*?) {2,}(-?[\d.]+)$", output, re.MULTILINE)}


def trained(recipe: Recipe) -> tuple[dict[str, float], float]:
    """The returns that a recipe ends with, and the processor time (s) it took."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-W", "ignore", str(EXAMPLES / recipe.arguments[0]), *recipe.arguments[1:]]
    around = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(command, env=around, cwd=ROOT, capture_output=True, text=True)
    if done.returncode != 0:
        raise SystemExit(f"check-learners: {' '.join(recipe.arguments)} did not end well: {done.stderr[-500:]}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return returns_of(done.stdout), after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def checked(names: list[str]) -> Iterator[bool]:
    """Whether each recipe that can be tried held, told in a line."""
    for name in names:
        recipe = RECIPES[name]
        if missing := recipe.missing():
            print(f"{name}: not tried, for these are missing: pip install {' '.join(missing)}", flush=True)
            continue
        returns, seconds = trained(recipe)
        reached, needed = returns[recipe.learner], returns[recipe.beaten]
        held = reached > needed and seconds <= MOST
        others = ", ".join(f"{other} {value:.2f}" for other, value in returns.items() if other != recipe.learner)
        verdict = "held" if held else "FAILED"
        print(
            f"{name}: {verdict}: {recipe.learner} {reached:.2f} after {seconds:.0f} s of processor; {others}",
            flush=True,
        )
        yield held


def checked_environments() -> None:
    """stable-baselines3's own checker, on one arm in each of the environments that learners are given."""
    if importlib.util.find_spec("stable_baselines3") is None:
        print("checkers: not tried, for these are missing: pip install stable-baselines3")
        return
    import gymnasium
    from stable_baselines3.common.env_checker import check_env

    import adaptctl
    from adaptctl.envs import LearningEnv, ResidualEnv, TuningEnv

    arm = adaptctl.load("two_link")
    law = adaptctl.tune(arm, control_period=0.02).controller(adaptctl.ReducedModel.full(arm))
    inner = gymnasium.make("adaptctl.envs:adaptctl/Tracking-v0", robot=arm, control_period=0.02, duration=1.0)
    wrapped = [inner, ResidualEnv(inner, law), TuningEnv(inner, law, ["damping"])]
    for env in (gymnasium.make("adaptctl/Puma560Learning-v0"), *map(LearningEnv, wrapped)):
        check_env(env)
        print(f"checkers: held: {env}", flush=True)


def main() -> None:
    """Try the recipes that are named, all unless any is."""
    names = sys.argv[1:] or list(RECIPES)
    if unknown := [name for name in names if name not in RECIPES]:
        raise SystemExit(f"check-learners: unknown recipe {unknown[0]!r}; recipes: {', '.join(RECIPES)}")
    checked_environments()
    held = list(checked(names))
    if not held:
        raise SystemExit("check-learners: nothing could be tried")
    if not all(held):
        raise SystemExit("check-learners: FAILED")


if __name__ == "__main__":
    main()
