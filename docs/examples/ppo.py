"""Proximal policy optimisation (Schulman et al. 2017) in one file, in the manner of cleanrl; needs torch.

    python docs/examples/ppo.py                       # torques, PUMA 560
    python docs/examples/ppo.py --task residual       # torques beside a controller's, on joints with unknown friction
    python docs/examples/ppo.py --task tuning         # a controller's gains

Told at the end: the return of the mean action, without noise, beside those of controllers.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

import adaptctl
from adaptctl.envs import LearningVectorEnv, Puma560VectorTrackingEnv, ResidualVectorEnv, TuningVectorEnv, baselines
from adaptctl.simulation.effects import Friction

LARGEST = 10.0
"""reward in units of returns; a fall costs no more"""
FRICTION = Friction(viscous=3.0, coulomb=(8.0, 12.0, 6.0, 2.0, 2.0, 1.5))
"""of the residual task's joints: N m s/rad and N m; the controller's model has none"""


OF_TASK = {
    "tracking": {},
    "residual": {"seconds": 60.0, "log_std_init": -1.5, "log_std_last": -3.0},
    "tuning": {"seconds": 60.0},
}
"""settings of each task that differ"""


@dataclass
class Settings:
    """What can be chosen on the command line, such as --seconds 60; see also OF_TASK."""

    task: str = "tracking"
    seed: int = 0
    seconds: float = 120.0
    """of processor time, after which it ends"""
    arms: int = 64
    horizon: int = 64
    """steps of each arm between two updates"""
    epochs: int = 5
    minibatch: int = 1024
    learning_rate: float = 2e-3
    """at first; a tenth at the end"""
    gamma: float = 0.97
    trace: float = 0.95
    """lambda of generalised advantage estimation"""
    clip: float = 0.2
    log_std_init: float = -1.0
    """logarithm of the noise's deviation; it is learned, but not above the line from this to `log_std_last`"""
    log_std_last: float = -2.5
    width: int = 64
    largest_gradient: float = 0.5


class Policy(nn.Module):
    """A normal distribution of actions, and the value of observations."""

    def __init__(self, observed: int, acted: int, width: int, log_std: float) -> None:
        super().__init__()
        self.mean = network(observed, width, acted, 0.01)
        self.value = network(observed, width, 1, 1.0)
        self.log_std = nn.Parameter(torch.full((acted,), log_std))

    def distribution(self, observation: Tensor) -> torch.distributions.Normal:
        """Of the actions (n, a) at observations (n, o)."""
        return torch.distributions.Normal(self.mean(observation), self.log_std.exp())


def network(rows: int, width: int, columns: int, gain: float) -> nn.Sequential:
    """Two hidden layers; the gain is the last one's."""
    layers = [nn.Linear(rows, width), nn.Linear(width, width), nn.Linear(width, columns)]
    for layer, scale in zip(layers, (2.0**0.5, 2.0**0.5, gain), strict=True):
        nn.init.orthogonal_(layer.weight, scale)
        nn.init.zeros_(layer.bias)
    return nn.Sequential(layers[0], nn.Tanh(), layers[1], nn.Tanh(), layers[2])


class RewardScale:
    """Divides rewards by the root mean square of discounted returns of late: those of the first falls are forgotten."""

    def __init__(self, arms: int, gamma: float, memory: float = 0.999) -> None:
        self.returns, self.gamma, self.memory = np.zeros(arms), gamma, memory
        self.square, self.weight = 0.0, 0.0

    def __call__(self, rewards: np.ndarray, over: np.ndarray) -> np.ndarray:
        """Rewards (N,) in units of returns."""
        self.returns = self.gamma * self.returns + rewards
        self.square = self.memory * self.square + (1.0 - self.memory) * np.mean(self.returns**2)
        self.weight = self.memory * self.weight + (1.0 - self.memory)
        self.returns[over] = 0.0
        return np.clip(rewards / np.sqrt(self.square / self.weight + 1e-8), -LARGEST, LARGEST)


class Batch:
    """What happened to N arms in T steps: (T, N, ...)."""

    def __init__(self, horizon: int, arms: int, observed: int, acted: int) -> None:
        self.observation = torch.zeros(horizon, arms, observed)
        self.action = torch.zeros(horizon, arms, acted)
        self.log_p, self.value, self.reward, self.over, self.after = (torch.zeros(horizon, arms) for _ in range(5))

    def advantages(self, settings: Settings, last: Tensor) -> Tensor:
        """Generalised advantage estimates (Schulman et al. 2016), from the values (N,) of what is seen at the end.

        `after` are the values of the last observations of episodes that ended by their duration alone, else zero.
        """
        following = torch.cat((self.value[1:], last[None]))
        following = torch.where(self.over > 0.0, self.after, following)
        errors = self.reward + settings.gamma * following - self.value
        advantage, running = torch.zeros_like(errors), torch.zeros_like(last)
        for k in reversed(range(len(errors))):
            running = errors[k] + settings.gamma * settings.trace * (1.0 - self.over[k]) * running
            advantage[k] = running
        return advantage


class Arms:
    """The environment, what is seen in it now, and the returns of its episodes."""

    def __init__(self, env: LearningVectorEnv, settings: Settings) -> None:
        self.env, self.scale = env, RewardScale(env.num_envs, settings.gamma)
        self.seen = torch.as_tensor(env.reset(seed=settings.seed)[0])
        self.running, self.returns = np.zeros(env.num_envs), [float("nan")]

    @torch.no_grad()
    def drive(self, policy: Policy, batch: Batch) -> Batch:
        """Fill a batch."""
        for k in range(len(batch.reward)):
            distribution = policy.distribution(self.seen)
            action = distribution.sample()
            batch.observation[k], batch.action[k], batch.value[k] = self.seen, action, policy.value(self.seen)[:, 0]
            batch.log_p[k] = distribution.log_prob(action).sum(-1)
            seen, reward, terminated, truncated, info = self.env.step(action.clamp(-1.0, 1.0).numpy())
            over, late = terminated | truncated, truncated & ~terminated
            batch.reward[k] = torch.as_tensor(self.scale(reward, over))
            batch.over[k], batch.after[k] = torch.as_tensor(over), 0.0
            if late.any():
                last = torch.as_tensor(np.stack(list(info["final_obs"][late])))
                batch.after[k, torch.as_tensor(late)] = policy.value(last)[:, 0]
            self.running += reward
            self.returns = [*self.returns, *self.running[over].tolist()][-100:]
            self.running[over] = 0.0
            self.seen = torch.as_tensor(seen)
        return batch


def update(
    policy: Policy, optimiser: torch.optim.Optimizer, batch: Batch, advantage: Tensor, settings: Settings
) -> None:
    """Some epochs of gradient steps on a batch."""
    parts = batch.observation, batch.action, batch.log_p, advantage, advantage + batch.value
    flat = [part.flatten(0, 1) for part in parts]
    for _ in range(settings.epochs):
        for chosen in torch.randperm(len(flat[0])).split(settings.minibatch):
            observation, action, before, A, target = (part[chosen] for part in flat)
            A = (A - A.mean()) / (A.std() + 1e-8)
            ratio = (policy.distribution(observation).log_prob(action).sum(-1) - before).exp()
            gain = torch.minimum(ratio * A, ratio.clamp(1.0 - settings.clip, 1.0 + settings.clip) * A).mean()
            loss = 0.5 * (policy.value(observation)[:, 0] - target).square().mean() - gain
            optimiser.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(policy.parameters(), settings.largest_gradient)
            optimiser.step()


def train(env: LearningVectorEnv, settings: Settings) -> Policy:
    """A policy after so many seconds of the processor."""
    torch.manual_seed(settings.seed)
    sizes = env.single_observation_space.shape[0], env.single_action_space.shape[0]
    policy, arms = Policy(*sizes, settings.width, settings.log_std_init), Arms(env, settings)
    optimiser = torch.optim.Adam(policy.parameters(), eps=1e-5)
    started, updates, told = time.process_time(), 0, 0.0
    while (share := (time.process_time() - started) / settings.seconds) < 1.0:
        optimiser.param_groups[0]["lr"] = settings.learning_rate * (1.0 - 0.9 * share)
        bound = settings.log_std_init + share * (settings.log_std_last - settings.log_std_init)
        policy.log_std.data.clamp_(max=bound)
        batch = arms.drive(policy, Batch(settings.horizon, settings.arms, *sizes))
        with torch.no_grad():
            advantage = batch.advantages(settings, policy.value(arms.seen)[:, 0])
        update(policy, optimiser, batch, advantage, settings)
        updates += 1
        if share >= told:
            steps, told = updates * settings.horizon * settings.arms, told + 0.05
            seconds = time.process_time() - started
            print(f"{steps:>9} steps {seconds:6.0f} s  return with noise {np.mean(arms.returns):9.2f}", flush=True)
    return policy


@torch.no_grad()
def evaluate(env: LearningVectorEnv, policy: Policy | None = None) -> float:
    """The mean return of the first episode of every arm under the policy's mean actions, or under none."""
    observation, _ = env.reset(seed=1000)
    total, running = np.zeros(env.num_envs), np.ones(env.num_envs, dtype=bool)
    while running.any():
        action = np.zeros(env.action_space.shape, dtype=np.float32)
        if policy is not None:
            action = policy.mean(torch.as_tensor(observation)).clamp(-1.0, 1.0).numpy()
        observation, reward, terminated, truncated, _ = env.step(action)
        total += running * reward
        running &= ~(terminated | truncated)
    return float(total.mean())


def environment(task: str, arms: int) -> LearningVectorEnv:
    """Many arms in what is to be learned."""
    about: dict[str, Any] = {"control_period": 0.02, "duration": 5.0, "autoreset_mode": "SameStep"}
    if task == "tracking":
        return LearningVectorEnv(Puma560VectorTrackingEnv(arms, **about))
    if task == "residual":
        env = Puma560VectorTrackingEnv(arms, effects=[FRICTION], **about)
        return LearningVectorEnv(ResidualVectorEnv(env, controller(env), residual_scale=0.1))
    env = Puma560VectorTrackingEnv(arms, **about)
    return LearningVectorEnv(
        TuningVectorEnv(env, controller(env, hold=0.5), ["bandwidth", "damping", "adaptation.gain"])
    )


def controller(env: Puma560VectorTrackingEnv, hold: float = 1.0) -> adaptctl.SlotineLi:
    """Slotine and Li's law, which begins knowing nothing, with the gains that the control period carries."""
    arm, reference = env.single.mechanism, env.single.trajectory
    tuning = adaptctl.tune(
        arm, control_period=0.02, reference=reference, initial_error=0.1, bandwidth=8.0, sampling_ratio=hold
    )
    model = adaptctl.ReducedModel(arm)
    return tuning.controller(model, "gradient")


def main() -> None:
    """Train, and tell how it went."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", choices=OF_TASK, default="tracking")
    for field in fields(Settings)[1:]:
        name = f"--{field.name.replace('_', '-')}"
        parser.add_argument(
            name, type=type(field.default), default=argparse.SUPPRESS, help=f"{field.default} unless given"
        )
    given = vars(parser.parse_args())
    settings = Settings(**OF_TASK[given["task"]] | given)
    torch.set_num_threads(1)
    env = environment(settings.task, settings.arms)
    policy, one = train(env, settings), environment(settings.task, 1)
    returns = baselines(env) | {"no action": evaluate(one), "PPO": evaluate(one, policy)}
    for name, value in returns.items():
        print(f"{name:<28}{value:12.2f}")


if __name__ == "__main__":
    main()
