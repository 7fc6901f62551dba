"""Stable-baselines3's soft actor-critic (Haarnoja et al. 2018) or PPO on many arms at once; needs stable-baselines3.

    python docs/examples/sb3_learners.py --algorithm sac
    python docs/examples/sb3_learners.py --algorithm ppo

Told at the end: the return of the mean action, without noise, beside those of controllers.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import gymnasium
import torch
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecNormalize

from adaptctl.envs import RewardWeights, baselines
from adaptctl.envs.sb3 import TrackingVecEnv

ENVIRONMENT = "adaptctl/Puma560Learning-v0"
FALL = 100.0
"""what a fall costs while learning, in place of 1,000, next to which all else would be small"""
EVERY = 0.05
"""share of the time after which it is told how far it is"""


class Timed(BaseCallback):
    """Ends training after so many seconds of the processor, and tells in between."""

    def __init__(self, seconds: float) -> None:
        super().__init__()
        self.seconds, self.begun, self.told = seconds, time.process_time(), 0.0

    def _on_step(self) -> bool:
        share = (time.process_time() - self.begun) / self.seconds
        if share >= self.told:
            self.told += EVERY
            returns = evaluate(self.model)
            print(f"{self.num_timesteps:>9} steps {share * self.seconds:6.0f} s  return {returns:9.2f}", flush=True)
        return share < 1.0


def algorithm(name: str, seed: int) -> BaseAlgorithm:
    """What is to learn, rewards in units of returns."""
    many = gymnasium.make_vec(ENVIRONMENT, num_envs=64, reward_weights=RewardWeights(termination=FALL))
    env = VecNormalize(TrackingVecEnv(many), norm_obs=False, gamma=0.97)
    about: dict[str, Any] = {"gamma": 0.97, "seed": seed, "device": "cpu"}
    if name == "ppo":
        about |= {"n_steps": 64, "batch_size": 1024, "n_epochs": 5, "policy_kwargs": {"log_std_init": -1.0}}
        return PPO("MlpPolicy", env, learning_rate=1e-3, **about)
    about |= {"train_freq": 1, "gradient_steps": 8, "batch_size": 256, "learning_starts": 6400, "buffer_size": 500_000}
    network = {"net_arch": [64, 64], "optimizer_kwargs": {"fused": True}}
    return SAC("MlpPolicy", env, learning_rate=1e-3, ent_coef="auto_0.002", tau=0.02, policy_kwargs=network, **about)


def evaluate(model: BaseAlgorithm) -> float:
    """The return of an episode of the mean action."""
    env = gymnasium.make(ENVIRONMENT)
    observation, _ = env.reset(seed=1000)
    total, over = 0.0, False
    while not over:
        observation, reward, terminated, truncated, _ = env.step(model.predict(observation, deterministic=True)[0])
        total, over = total + float(reward), terminated or truncated
    return total


def main() -> None:
    """Train, and tell how it went."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--algorithm", choices=("ppo", "sac"), default="sac")
    parser.add_argument("--seconds", type=float, default=1100.0, help="of processor time")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    torch.set_num_threads(1)
    model = algorithm(chosen.algorithm, chosen.seed).learn(100_000_000, callback=Timed(chosen.seconds))
    returns = baselines(gymnasium.make(ENVIRONMENT)) | {chosen.algorithm.upper(): evaluate(model)}
    for name, value in returns.items():
        print(f"{name:<28}{value:12.2f}")


if __name__ == "__main__":
    main()
