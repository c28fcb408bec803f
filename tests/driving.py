"""Real simulations whose egos are driven by policies of the zoo."""

import hashlib
from contextlib import contextmanager

import numpy as np

from smarts.agents.policy import ActionBatch
from smarts.agents.spec import AgentSpec
from smarts.controllers import action_format
from smarts.observations.arrays import ArrayObservation
from smarts.observations.context import AdapterContext
from smarts.sim.assembly import Options, assemble
from smarts.sstudio.build import build_scenario
from smarts.types.agent_states import AgentStatus
from smarts.types.events import Outcome


def seed_of(*keys) -> int:
    digest = hashlib.blake2b("|".join(map(str, keys)).encode(), digest_size=8).digest()
    return int.from_bytes(digest, "little")


class Drive:
    """B simulations of a scenario, its first egos driven by one policy."""

    def __init__(self, parts, policy, egos, worlds, period):
        self.parts, self.policy, self.egos, self.worlds, self.period = parts, policy, egos, worlds, period
        agents = tuple(f"agent-{n}" for n in range(egos))
        kind = parts.rules.action[0]
        context = AdapterContext(parts.scene, agents, np.arange(egos, dtype=np.int32), kind, period, 0, ())
        self.format = action_format(kind)
        self.observation = ArrayObservation(context, policy.observation)
        self.world = parts.scene.world
        self.was_asked = np.zeros((worlds, egos), bool)
        self.actions, self.holds = None, np.zeros((worlds, egos), np.int32)
        self.outcomes = {}
        self.asked_batches = []

    def reset(self, episode=0, worlds=None):
        rows = range(self.worlds)
        self.parts.simulation.reset(
            {row: self.parts.schedule.start((worlds or [*rows])[row], episode) for row in rows}
        )
        self.names = worlds or [*rows]
        self.was_asked[:] = False
        self.observation.reset(np.ones_like(self.was_asked))
        return self

    @property
    def active(self):
        return self.world.agents.state[:, : self.egos] == AgentStatus.ACTIVE

    def batch(self, chosen):
        arrays = self.observation.observe(chosen)
        env_id, agent_id = np.nonzero(chosen)
        episode = self.world.episode[env_id]
        return ActionBatch(
            {name: array[chosen].copy() for name, array in arrays.items()},
            self.world.agents.action_mask[:, : self.egos][chosen].copy(),
            env_id.astype(np.int32),
            agent_id.astype(np.int32),
            np.zeros(len(env_id), np.int32),
            episode.astype(np.int32),
            self.world.step[env_id].astype(np.int32),
            ~self.was_asked[chosen],
            np.array(
                [seed_of(self.names[e], n, a) for e, n, a in zip(env_id, episode, agent_id, strict=True)],
                np.uint64,
            ),
        )

    def step(self):
        """Let all active egos decide, and step all simulations."""
        actions, chosen = self.parts.actions, self.active
        actions.fresh[:] = False
        if chosen.any() and self.world.step[0] % self.period == 0:
            batch = self.batch(chosen)
            given = np.asarray(self.policy.act(batch))
            parsed = self.format.parse_batch(given)
            assert isinstance(parsed, np.ndarray), parsed
            places = np.nonzero(chosen)
            self.format.write(parsed, places, actions)
            actions.given[places], actions.fresh[places] = True, True
            actions.action_mask[places] = batch.action_mask
            self.was_asked |= chosen
            self.asked_batches.append((batch, given))
        everyone = np.ones(self.worlds, bool)
        frame = self.parts.simulation.step(actions, everyone, np.zeros(actions.given.shape, bool))
        for row, ego in zip(*np.nonzero(frame.events.just_done), strict=True):
            outcome = Outcome(self.world.agents.outcome[row, ego])
            self.outcomes[int(row), int(ego)] = outcome.name
        return frame


@contextmanager
def driven(spec: AgentSpec, scenario: str, *, egos=1, worlds=1, seed=42, path=64, variation=None):
    built = build_scenario(scenario)
    policy = spec.build_agent()
    parts = assemble([built], [spec.interface] * egos, worlds=worlds, seed=seed, options=Options(path=path))
    try:
        yield Drive(parts, policy, egos, worlds, policy.period)
    finally:
        parts.simulation.close()
