"""Proximal policy optimisation (Schulman et al. 2017) in one file, in the manner of cleanrl; needs torch.

    python docs/examples/ppo.py --seconds 600

What is told at the end are returns of the mean action, with no noise, beside those of controllers.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, fields

import numpy as np
import torch
from torch import Tensor, nn

from adaptctl.envs import Puma560VectorTrackingEnv
from adaptctl.envs.learning import LearningVectorEnv


@dataclass
class Settings:
    """What can be chosen on the command line, such as --seconds 60."""

    seed: int = 0
    seconds: float = 600.0
    """of processor time, after which it ends"""
    steps: int = 20_000_000
    """of one arm, after which it ends"""
    arms: int = 64
    horizon: int = 64
    """steps of each arm between two updates"""
    epochs: int = 5
    minibatch: int = 1024
    learning_rate: float = 1e-3
    gamma: float = 0.97
    trace: float = 0.95
    """lambda of generalised advantage estimation"""
    clip: float = 0.2
    entropy: float = 0.0
    log_std: float = -1.0
    """logarithm of the noise's deviation, in shares of the torque limits, in the beginning"""
    last_log_std: float = -3.5
    """and at the end; the deviation is learned in between, but not above what is on the line from one to the other"""
    width: int = 64
    skip: int = 0
    largest_gradient: float = 0.5


class Policy(nn.Module):
    """A normal distribution of actions, and the value of observations."""

    def __init__(self, observed: int, acted: int, settings: Settings) -> None:
        super().__init__()
        width = settings.width
        self.mean = nn.Sequential(_layer(observed, width), nn.Tanh(), _layer(width, width), nn.Tanh(), _layer(width, acted, 0.01))
        self.value = nn.Sequential(_layer(observed, width), nn.Tanh(), _layer(width, width), nn.Tanh(), _layer(width, 1, 1.0))
        self.linear = nn.Linear(observed, acted, bias=False)
        nn.init.zeros_(self.linear.weight)
        self.skip = settings.skip
        self.log_std = nn.Parameter(torch.full((acted,), settings.log_std))

    def act(self, o):
        return self.mean(o) + self.linear(o) if self.skip else self.mean(o)

    def distribution(self, observation: Tensor) -> torch.distributions.Normal:
        return torch.distributions.Normal(self.act(observation), self.log_std.exp().expand(len(observation), -1))


def _layer(rows: int, columns: int, gain: float = 2.0**0.5) -> nn.Linear:
    layer = nn.Linear(rows, columns)
    nn.init.orthogonal_(layer.weight, gain)
    nn.init.zeros_(layer.bias)
    return layer


class RewardScale:
    """Divides rewards by the root mean square of discounted returns, of late: those of the first falls are forgotten."""

    def __init__(self, arms: int, gamma: float, memory: float = 0.999) -> None:
        self.returns, self.gamma, self.memory = np.zeros(arms), gamma, memory
        self.square, self.weight = 0.0, 0.0

    def __call__(self, rewards: np.ndarray, done: np.ndarray) -> np.ndarray:
        """Rewards (N,) in units of returns, at most LARGEST of them."""
        self.returns = self.gamma * self.returns + rewards
        self.square = self.memory * self.square + (1.0 - self.memory) * np.mean(self.returns**2)
        self.weight = self.memory * self.weight + (1.0 - self.memory)
        self.returns[done] = 0.0
        return np.clip(rewards / np.sqrt(self.square / self.weight + 1e-8), -10.0, 10.0)


def train(env: LearningVectorEnv, settings: Settings, told=print) -> Policy:
    torch.manual_seed(settings.seed)
    observed, acted = env.single_observation_space.shape[0], env.single_action_space.shape[0]
    policy = Policy(observed, acted, settings)
    optimiser = torch.optim.Adam(policy.parameters(), settings.learning_rate, eps=1e-5)
    shape = settings.horizon, settings.arms
    scale = RewardScale(settings.arms, settings.gamma)
    observation = torch.as_tensor(env.reset(seed=settings.seed)[0])
    begun, done_steps, returns, running = time.process_time(), 0, [], np.zeros(settings.arms)
    update = 0
    while (share := max((time.process_time() - begun) / settings.seconds, done_steps / settings.steps)) < 1.0:
        update += 1
        optimiser.param_groups[0]["lr"] = settings.learning_rate * (1.0 - 0.9 * share)
        with torch.no_grad():
            bound = settings.log_std + share * (settings.last_log_std - settings.log_std)
            policy.log_std.clamp_(max=bound)
        observations, actions = torch.zeros(*shape, observed), torch.zeros(*shape, acted)
        log_p, values, rewards, ends, next_values = (torch.zeros(shape) for _ in range(5))
        for k in range(settings.horizon):
            with torch.no_grad():
                distribution = policy.distribution(observation)
                action = distribution.sample()
                values[k] = policy.value(observation)[:, 0]
            observations[k], actions[k], log_p[k] = observation, action, distribution.log_prob(action).sum(-1)
            seen, reward, terminated, truncated, info = env.step(action.clamp(-1.0, 1.0).numpy())
            over = terminated | truncated
            running += reward
            returns.extend(running[over].tolist())
            running[over] = 0.0
            rewards[k], ends[k] = torch.as_tensor(scale(reward, over)), torch.as_tensor(over)
            observation = torch.as_tensor(seen)
            if truncated.any():  # what would have come is estimated: the episode ended by its duration alone
                last = torch.as_tensor(np.stack(info["final_obs"][truncated & ~terminated].tolist())) if (truncated & ~terminated).any() else None
                if last is not None:
                    with torch.no_grad():
                        next_values[k, torch.as_tensor(truncated & ~terminated)] = policy.value(last)[:, 0]
        with torch.no_grad():
            following = torch.cat((values[1:], policy.value(observation)[None, :, 0]))
        following = torch.where(ends > 0.0, next_values, following)
        errors, advantage, running_advantage = rewards + settings.gamma * following - values, torch.zeros(shape), torch.zeros(settings.arms)
        for k in reversed(range(settings.horizon)):
            running_advantage = errors[k] + settings.gamma * settings.trace * (1.0 - ends[k]) * running_advantage
            advantage[k] = running_advantage
        targets = (advantage + values).flatten()
        done_steps += settings.horizon * settings.arms
        flat = observations.flatten(0, 1), actions.flatten(0, 1), log_p.flatten(), advantage.flatten(), targets
        for _ in range(settings.epochs):
            for chosen in torch.randperm(len(targets)).split(settings.minibatch):
                o, a, before, A, R = (x[chosen] for x in flat)
                A = (A - A.mean()) / (A.std() + 1e-8)
                distribution = policy.distribution(o)
                ratio = (distribution.log_prob(a).sum(-1) - before).exp()
                gain = torch.minimum(ratio * A, ratio.clamp(1.0 - settings.clip, 1.0 + settings.clip) * A).mean()
                loss = -gain + 0.5 * (policy.value(o)[:, 0] - R).square().mean() - settings.entropy * distribution.entropy().sum(-1).mean()
                optimiser.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(policy.parameters(), settings.largest_gradient)
                optimiser.step()
        if update % 20 == 0:
            told(f"{done_steps:>9} steps {time.process_time() - begun:6.1f} s return {np.mean(returns[-100:] or [np.nan]):10.2f} "
                 f"deviation {policy.log_std.exp().mean().item():.3f}", flush=True)
            if update % 100 == 0:
                print("   eval", evaluate(policy, settings.make(1) if hasattr(settings,'make') else LearningVectorEnv(Puma560VectorTrackingEnv(1, autoreset_mode="SameStep", control_period=0.02, duration=5.0))), flush=True)
    return policy


def evaluate(policy: Policy, env: LearningVectorEnv) -> float:
    """The mean return of the first episode of every arm, without noise."""
    observation, _ = env.reset(seed=1000)
    total, running = np.zeros(env.num_envs), np.ones(env.num_envs, dtype=bool)
    while running.any():
        with torch.no_grad():
            action = policy.act(torch.as_tensor(observation)).clamp(-1.0, 1.0).numpy()
        observation, reward, terminated, truncated, _ = env.step(action)
        total += running * reward
        running &= ~(terminated | truncated)
    return float(total.mean())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    for field in fields(Settings):
        parser.add_argument(f"--{field.name.replace('_', '-')}", type=type(field.default), default=field.default)
    settings = Settings(**vars(parser.parse_args()))
    torch.set_num_threads(1)
    env = LearningVectorEnv(Puma560VectorTrackingEnv(settings.arms, autoreset_mode="SameStep", control_period=0.02, duration=5.0))
    policy = train(env, settings)
    one = LearningVectorEnv(Puma560VectorTrackingEnv(1, autoreset_mode="SameStep", control_period=0.02, duration=5.0))
    print("mean action", evaluate(policy, one))


if __name__ == "__main__":
    main()
