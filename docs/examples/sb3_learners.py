"""Stable-baselines3's soft actor-critic (Haarnoja et al. 2018) or PPO on many arms at once; needs stable-baselines3.

    python docs/examples/sb3_learners.py --algorithm sac
    python docs/examples/sb3_learners.py --algorithm ppo

Told at the end: the return of the mean action, without noise, beside those of controllers.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import torch
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from adaptctl.envs import baselines
from adaptctl.envs.sb3 import TrackingVecEnv

ENVIRONMENT = "adaptctl/Puma560Learning-v0"
SMALL, LARGE = 0.01, 20.0
"""costs of a control period: what is left when an arm is tracked well, and what is hardly exceeded before a fall"""
QUIET = -2.0
"""logarithm of soft actor-critic's noise at first: an arm shaken by more falls whatever it does"""
WIDTH = 64
REPORTS = 20


class Logarithms(VecEnvWrapper):
    """Rewards of -log(1 + cost / SMALL) in units of LARGE's: as much is won by halving a small cost as a large one.

    A fall costs what LARGE costs for ever: it is no way out, and what is won by tracking well is not small beside it.
    """

    def __init__(self, env: VecEnv, gamma: float) -> None:
        super().__init__(env)
        self.fall = -1.0 / (1.0 - gamma)

    def reset(self) -> Any:
        """The first observations (N, n)."""
        return self.venv.reset()

    def step_wait(self) -> Any:
        """Observations (N, n), rewards (N,), ends (N,) and infos after one control period."""
        seen, rewards, done, infos = self.venv.step_wait()
        fell = done & [not info.get("TimeLimit.truncated", False) for info in infos]
        costs = np.log1p(-rewards / SMALL) / np.log1p(LARGE / SMALL)
        return seen, np.where(fell, self.fall, -costs), done, infos


class Progress(BaseCallback):
    """Tells in between how far it is."""

    def __init__(self, steps: int) -> None:
        super().__init__()
        self.every, self.told, self.started = steps / REPORTS, 0.0, time.process_time()

    def _on_step(self) -> bool:
        if self.num_timesteps >= self.told:
            self.told += self.every
            seconds, returns = time.process_time() - self.started, evaluate(self.model)
            print(f"{self.num_timesteps:>9} steps {seconds:6.0f} s  return {returns:9.2f}", flush=True)
        return True


def proximal(seed: int) -> PPO:
    """Proximal policy optimisation."""
    env = Logarithms(TrackingVecEnv(gymnasium.make_vec(ENVIRONMENT, num_envs=64)), gamma=0.97)
    about: dict[str, Any] = {"gamma": 0.97, "seed": seed, "device": "cpu", "learning_rate": falling(2e-3)}
    about |= {"n_steps": 64, "batch_size": 1024, "n_epochs": 5, "policy_kwargs": {"log_std_init": -1.0}}
    return PPO("MlpPolicy", env, **about)


def soft(seed: int) -> SAC:
    """Soft actor-critic that begins quietly and is to end with little noise, its critics normalised layer by layer."""
    env = Logarithms(TrackingVecEnv(gymnasium.make_vec(ENVIRONMENT, num_envs=64)), gamma=0.95)
    layers = {"net_arch": [WIDTH, WIDTH], "optimizer_kwargs": {"fused": True}}
    about: dict[str, Any] = {"gamma": 0.95, "seed": seed, "device": "cpu", "learning_rate": falling(2e-3)}
    about |= {"batch_size": 256, "buffer_size": 100_000, "learning_starts": 0, "train_freq": 1, "gradient_steps": 1}
    about |= {"tau": 0.01, "ent_coef": "auto_0.005", "target_entropy": -10.0, "policy_kwargs": layers}
    model = SAC("MlpPolicy", env, **about)
    with torch.no_grad():
        for layer, bias in ((model.actor.mu, 0.0), (model.actor.log_std, QUIET)):
            layer.weight.mul_(0.01)
            layer.bias.fill_(bias)
    for critic in (model.critic, model.critic_target):
        for network in critic.q_networks:
            for k in (1, 3):
                network[k] = torch.nn.Sequential(torch.nn.LayerNorm(WIDTH, elementwise_affine=False), network[k])
    return model


def falling(rate: float) -> Callable[[float], float]:
    """The learning rate by the share that is left."""
    return lambda left: rate * max(left, 0.1)


def evaluate(model: BaseAlgorithm) -> float:
    """The return of an episode of the mean action."""
    env = gymnasium.make(ENVIRONMENT)
    observation, _ = env.reset(seed=1000)
    total, over = 0.0, False
    while not over:
        observation, reward, terminated, truncated, _ = env.step(model.predict(observation, deterministic=True)[0])
        total, over = total + float(reward), terminated or truncated
    return total


ALGORITHMS: dict[str, Callable[[int], BaseAlgorithm]] = {"ppo": proximal, "sac": soft}


def main() -> None:
    """Train, and tell how it went."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--algorithm", choices=ALGORITHMS, default="sac")
    parser.add_argument("--steps", type=int, default=1_500_000, help="of all arms together")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    torch.set_num_threads(1)
    model = ALGORITHMS[chosen.algorithm](chosen.seed).learn(chosen.steps, callback=Progress(chosen.steps))
    returns = baselines(gymnasium.make(ENVIRONMENT)) | {chosen.algorithm.upper(): evaluate(model)}
    for name, value in returns.items():
        print(f"{name:<28}{value:12.2f}")


if __name__ == "__main__":
    main()
