"""The paper's programmatic interface: `Metric` counts while a simulation runs.

    metric = Metric(num_episodes=10)
    for _ in range(10):
        episode = Episode()
        while ...:
            ...
            metric.log_step(observations, actions, rewards, dones, infos, episode=episode)
    metric.compute()

An episode is an `Episode` object, which takes each step in, or the number or name of one; `Metric` then makes
the object. Agents that still drive when nothing more is logged have timed out: the caller's loop was their
time limit, and the outcomes add up to 1.

It reads what agents observe: how they ended, their rewards, the way to the goal, their actions. So it has
collision and completion rate, the outcome shares, safety (its first term), control diversity (of lane
actions; every lane change that was asked for counts as carried out), progress speed, goal distance, return
and decisions per second. The others need the paths of other vehicles: record the episodes and use
`measure_episodes`.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd

from benchmark.metrics.registry import METRICS
from benchmark.metrics.safety import LEAST_DRIVEN
from smarts.errors import SmartsError, shown
from smarts.types.actions import LaneAction
from smarts.types.events import Outcome

TIME_OUT = Outcome.TIME_OUT.name.lower()

MEASURED = (
    "collision_rate",
    "completion_rate",
    "safety",
    "control_diversity",
    "progress_speed",
    "ended_off_road",
    "ended_off_route",
    "ended_missed_goal",
    "ended_not_moving",
    "ended_time_out",
    "ended_other",
    "ended_other_terminal",
    "goal_distance",
    "return",
    "decision_rate",
)
"""Metrics that need observations, rewards and infos only."""

UNFINISHED = "unfinished"
"""Share of agents that still drove when logging stopped; they count as timed out."""


@dataclass
class AgentLog:
    """One agent in one episode."""

    rewards: list[float] = field(default_factory=list)
    actions: list[Any] = field(default_factory=list)
    seen: list[Any] = field(default_factory=list)
    """First and latest observation, as objects."""
    outcome: str = ""
    """Name of an `Outcome` in lower case, "" while it drives."""


@dataclass
class EpisodeLog:
    """What was logged of one episode."""

    agents: dict[str, AgentLog] = field(default_factory=dict)
    steps: int = 0
    """Decisions."""


@dataclass
class Episode(EpisodeLog):
    """An episode that is being played; inherit to keep more of it. It records what `log_step` is given."""

    def record_step(self, **step: Any) -> None:
        """Take in one decision.

        Args:
            step: observations, actions, rewards, dones, infos: dicts of agents, as `HiWayEnv.step` gives and
                takes them; actions may be left out. Agents that have ended are passed over.
        """
        self.steps += 1
        for name in step["rewards"]:
            log = self.agents.setdefault(name, AgentLog())
            if log.outcome:
                continue
            log.rewards.append(float(step["rewards"][name]))
            actions = step.get("actions") or {}
            if name in actions:
                log.actions.append(actions[name])
            info = step["infos"].get(name, {})
            seen = info.get("env_obs", step["observations"].get(name))
            if hasattr(seen, "ego_vehicle_state"):
                log.seen = [*log.seen[:1], seen]
            log.outcome = str(info.get("outcome", ""))
            if step["dones"].get(name) and not log.outcome:
                log.outcome = _outcome_of(seen)


class Metric:
    """Counts over episodes while they are played.

    To add to it, inherit: `Metric.episode` is the class that records, `columns` what is made of an agent's
    log, `METRICS` what is computed.

    Args:
        num_episodes: How many are wanted; more are refused.
    """

    episode = Episode

    def __init__(self, num_episodes: int = 1) -> None:
        self.num_episodes = num_episodes
        self.episodes: dict[Hashable, Any] = {}
        """The objects that record, by name; the caller's own by their identity."""

    def log_step(
        self,
        observations: Mapping[str, Any],
        actions: Mapping[str, Any] | None = None,
        rewards: Mapping[str, float] | None = None,
        dones: Mapping[str, bool] | None = None,
        infos: Mapping[str, Mapping[str, Any]] | None = None,
        episode: EpisodeLog | Hashable = 0,
    ) -> None:
        """Take in one decision of all agents.

        Args:
            observations: After it, by agent.
            actions: That led to it; None if they are not at hand.
            rewards: For it.
            dones: Whose episode has ended: terminated or truncated. `terminateds` alone will do where infos
                say the outcome, as those of all environments of `smarts.env` do.
            infos: `HiWayEnv`'s, with outcome and observation object.
            episode: An `Episode`, or the number or name of one.

        Raises:
            SmartsError: There are more episodes than were announced, or this is none.
        """
        self._episode(episode).record_step(
            observations=observations,
            actions=actions,
            rewards=rewards or {},
            dones=dones or {},
            infos=infos or {},
        )

    def columns(self, log: AgentLog) -> dict[str, float]:
        """Return the columns of one agent-episode, as the metrics of recorded episodes write them."""
        outcomes = {
            f"ended_{outcome.name.lower()}": float(log.outcome == outcome.name.lower()) for outcome in Outcome
        }
        return {
            "agents": 1.0,
            "collisions": outcomes["ended_collision"],
            "goals": outcomes["ended_goal"],
            **outcomes,
            "return": sum(log.rewards),
            "returns": 1.0,
            "decisions": float(len(log.rewards)),
            **_safety_columns(log, outcomes["ended_collision"]),
            **_seen_columns(log),
            **_command_columns(log),
        }

    def compute(self) -> dict[str, float]:
        """Return each metric and `UNFINISHED`, NaN where there is nothing to measure.

        May be called while episodes are played: agents that still drive count as timed out, for now.
        """
        logs = [log for episode in self.episodes.values() for log in episode.agents.values()]
        if not logs:
            return dict.fromkeys((*MEASURED, UNFINISHED), float("nan"))
        rows = pd.DataFrame(
            [self.columns(log if log.outcome else replace(log, outcome=TIME_OUT)) for log in logs]
        )
        totals = {name: np.array(sum(rows[name])) for name in rows}
        found = {name: float(METRICS[name].known(totals)) for name in MEASURED}
        return found | {UNFINISHED: sum(not log.outcome for log in logs) / len(logs)}

    def _episode(self, given: Any) -> Any:
        """Return what records an episode."""
        is_log = isinstance(given, EpisodeLog)
        if not (hasattr(given, "record_step") if is_log else isinstance(given, Hashable)):
            raise _error(given, "is not an episode", "give an Episode(), or the number or name of one")
        # Dataclasses compare by content, so that they have no hash; a subclass may restore it.
        name = (EpisodeLog, id(given)) if is_log else given
        if name not in self.episodes:
            if len(self.episodes) >= self.num_episodes:
                problem = f"is one more than the {self.num_episodes} announced"
                raise _error(given, problem, "give Metric a larger num_episodes, or log all steps as one")
            self.episodes[name] = given if is_log else self.episode()
        return self.episodes[name]


def _error(episode: Any, problem: str, remedy: str) -> SmartsError:
    return SmartsError(f"episode {shown(episode, 100)} {problem}", place="Metric.log_step", remedy=remedy)


def _outcome_of(seen: Any) -> str:
    """Return the outcome that an observation's events tell of, for infos that do not say it."""
    events = getattr(seen, "events", None)
    if events is None:
        return "other"
    happened = {
        "collision": bool(events.collisions),
        "off_road": events.off_road,
        "off_route": events.off_route,
        "missed_goal": getattr(events, "missed_goal", False),
        "goal": events.reached_goal,
        "not_moving": events.not_moving,
        "time_out": events.reached_max_episode_steps,
    }
    return next((name for name, is_so in happened.items() if is_so), "other")


def _safety_columns(log: AgentLog, collision: float) -> dict[str, float]:
    """Return the columns of safety; an agent without observations counts as one that drove."""
    driven = float(not log.seen or log.seen[-1].distance_travelled >= LEAST_DRIVEN)
    unknown = ("timed_decisions", "safe_decisions", "timed_gaps", "safe_gaps")
    return {"driven_agents": driven, "driven_collisions": driven * collision, **dict.fromkeys(unknown, 0.0)}


def _seen_columns(log: AgentLog) -> dict[str, float]:
    names = ("goal_distance", "bound_agents", "progress", "progress_time", "seconds")
    columns: dict[str, float] = {name: 0.0 for name in names}
    if not log.seen:
        return columns
    first, last = log.seen[0], log.seen[-1]
    mission = last.ego_vehicle_state.mission
    decision = last.steps_completed * last.dt / max(len(log.rewards), 1)
    columns["seconds"] = last.steps_completed * last.dt
    if mission.route_length > 0:
        columns["goal_distance"], columns["bound_agents"] = mission.remaining, 1.0
        columns["progress"] = first.ego_vehicle_state.mission.remaining - mission.remaining
        # The first observation that is logged is the one after the first decision.
        columns["progress_time"] = max(columns["seconds"] - decision, 0.0)
    return columns


def _command_columns(log: AgentLog) -> dict[str, float]:
    chosen = [_lane_action(action) for action in log.actions]
    across = chosen.count(LaneAction.change_lane_left) + chosen.count(LaneAction.change_lane_right)
    return {
        "speed_commands": float(chosen.count(LaneAction.slow_down)),
        "steering_commands": float(across),
        "command_metres": log.seen[-1].distance_travelled if log.seen else 0.0,
    }


def _lane_action(action: Any) -> LaneAction | None:
    """Return the lane action that an action is, by number or name; None for other kinds."""
    if isinstance(action, str):
        return LaneAction.__members__.get(action)
    if isinstance(action, int | np.integer) and 0 <= int(action) < len(LaneAction):
        return LaneAction(int(action))
    return None
