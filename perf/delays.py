"""Let agents of the zoo drive across the intersection with delayed actions, and count how their drives end.

    python -m perf.delays [LOCATOR...] [--delays 0 1 2 3 5] [--episodes 16] [--seed 7] [--import PATH...]

What an agent decides at step k is carried out at step k + delay (`delay_steps` of docs/hosts.md). A step is
0.1 s. Each episode has four of the agent's vehicles, on the missions of the task's egos in its traffic; all
agents and delays play the same episodes. Printed: the shares of vehicles that collided and that
came to their goals, with Wilson's 95% intervals, which treat the vehicles of an episode as independent; how
many of the others ended in which way; the mean time of those at their goals [s].
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence

import numpy as np

from benchmark.statistics import wilson_interval
from smarts.agents.hosting.options import HostOptions
from smarts.agents.social import ALL_MISSIONS, SocialAgents
from smarts.env.actions import ActionEncoder
from smarts.env.casting import cast_of
from smarts.env.social_agents import SocialAgentRequests
from smarts.registry import import_own
from smarts.sim.assembly import Assembly, assemble
from smarts.sstudio.build import build_scenario
from smarts.types.agent_states import AgentStatus
from smarts.types.episode import EpisodeStart
from smarts.types.events import Outcome

SCENARIO, TRAFFIC = "intersection", "random_social_vehicles"
AGENTS = ("idm-v0", "mobil-v0", "aggressive-v0", "gap-acceptance-v0")
LONGEST = 600
"""Steps of an episode."""


class Drives:
    """Plays episodes in which an agent drives all missions.

    Args:
        locator: Of the agent.
        delay: Steps from a decision to when it is carried out.
        seed: Of the run.
    """

    def __init__(self, locator: str, delay: int, seed: int) -> None:
        built = build_scenario(SCENARIO).with_traffic([TRAFFIC])
        hosts = {locator: HostOptions(delay_steps=delay)}
        cast = cast_of([built], [SocialAgents(locator, ALL_MISSIONS)], hosts=hosts)
        self.parts: Assembly = assemble([built], [], seed=seed, cast=cast)
        self.ended: Counter[Outcome] = Counter()
        """Vehicles by outcome; NONE: still driving after `LONGEST` steps."""
        self.times: list[float] = []
        """From entry to goal [s]."""

    def play(self, start: EpisodeStart) -> None:
        """Play an episode."""
        parts, mask = self.parts, np.ones(1, np.bool_)
        world = parts.simulation.world
        agents = world.agents
        requests = SocialAgentRequests(parts, ActionEncoder(parts.actions, agents.action_mask))
        frame, outcomes = parts.simulation.reset({0: start}), {}
        requests.begin([0])
        for _ in range(LONGEST):
            requests.dispatch(frame, frame.observe_mask.copy())
            failed = requests.gather()
            if failed:
                raise SystemExit(f"the agent failed: {next(iter(failed.values()))}")
            due = agents.next_due <= world.step[:, None] + 1
            frame = parts.simulation.step(parts.actions, mask, due, failed)
            for error in frame.failures.values():
                raise error
            parts.actions.fresh[:] = False
            for column in np.flatnonzero(agents.state[0] == AgentStatus.DONE).tolist():
                outcome = Outcome(int(agents.outcome[0, column]))
                outcomes[int(agents.agent[0, column])] = outcome
                if outcome == Outcome.GOAL:
                    steps = int(world.step[0]) - int(agents.entry_step[0, column])
                    self.times.append(steps * world.dt)
            if len(outcomes) == len(start.agents):
                break
        requests.close()
        self.ended.update(outcomes.values())
        self.ended[Outcome.NONE] += len(start.agents) - len(outcomes)


def drives(locator: str, delay: int, episodes: int, seed: int) -> Drives:
    """Return how an agent's drives ended in some episodes."""
    played = Drives(locator, delay, seed)
    try:
        for episode in range(episodes):
            played.play(played.parts.schedule.start(0, episode))
    finally:
        played.parts.simulation.close()
    return played


def row(locator: str, delay: int, played: Drives) -> str:
    """Return a line of the table."""
    ended, cells = +played.ended, []
    count = max(ended.total(), 1)
    for outcome in (Outcome.COLLISION, Outcome.GOAL):
        share = ended.pop(outcome, 0) / count
        low, high = wilson_interval(share, count)
        cells.append(f"{share:.2f} ({low:.2f} to {high:.2f})")
    others = ", ".join(f"{outcome.name} {number}" for outcome, number in sorted(ended.items())) or "none"
    time = f"{np.mean(played.times):.1f}" if played.times else "-"
    return f"| {' | '.join((locator, f'{delay}', f'{count}', *cells, others, time))} |"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a line for each agent and delay."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("locators", nargs="*", default=[*AGENTS])
    parser.add_argument("--delays", nargs="+", type=int, default=[0, 1, 2, 3, 5], help="steps of 0.1 s")
    parser.add_argument("--episodes", type=int, default=16)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--import", dest="imports", nargs="*", default=[], help="files of own code")
    given = parser.parse_args(arguments)
    import_own(given.imports)
    print(
        "| agent | delay | vehicles | collided | at the goal | others | time |\n|---|---|---|---|---|---|---|"
    )
    for locator in given.locators:
        for delay in given.delays:
            played = drives(locator, delay, given.episodes, given.seed)
            print(row(locator, delay, played), flush=True)


if __name__ == "__main__":
    main()
