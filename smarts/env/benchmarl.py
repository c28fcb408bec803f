"""A task of BenchMARL, whose algorithms then train on the scenarios; needs `pip install benchmarl`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from benchmarl.environments.pettingzoo.common import PettingZooClass
from numpy.random import SeedSequence
from torchrl.data import Composite
from torchrl.envs import EnvBase
from torchrl.envs.libs.pettingzoo import PettingZooWrapper

from smarts.env.black_death import BlackDeath
from smarts.env.parallel import hiway_parallel_env

GROUP = "agents"


class HiWayTask(PettingZooClass):
    """Scenarios with a fixed number of agents, all of one group.

    Agents that have ended stay in the batch until all have; see `BlackDeath`. Each environment that
    BenchMARL makes of the task in its own process, for training or evaluation, plays episodes of its own;
    with `parallel_collection` those of all processes are the same.

    Args:
        scenarios: Folders, or names of the suite; they are played in a seeded order.
        agents: How many agents.
        max_steps: Most decisions of an episode.
        options: Options of `hiway_parallel_env`.
    """

    def __init__(
        self, scenarios: Sequence[str | Path], agents: int = 4, max_steps: int = 200, **options: Any
    ) -> None:
        names = "-".join(Path(each).name for each in scenarios)
        super().__init__(names, {"scenarios": [str(each) for each in scenarios], "agents": agents, **options})
        self._max_steps, self._made = max_steps, 0

    def get_env_fun(
        self, num_envs: int, continuous_actions: bool, seed: int | None, device: Any
    ) -> Callable[[], EnvBase]:
        """Return what makes one simulation, each time with another seed."""
        run_seed = self.config.get("seed", 42) if seed is None else seed
        self._made += 1
        # BenchMARL asks once for training and once for evaluation, and makes several environments of each.
        seeds = SeedSequence([run_seed, self._made])

        def make() -> EnvBase:
            own = int(seeds.spawn(1)[0].generate_state(1)[0] % 2**31)
            config: dict[str, Any] = {**self.config, "seed": own}
            env = BlackDeath(hiway_parallel_env(**config))
            return PettingZooWrapper(
                env, group_map={GROUP: env.possible_agents}, done_on_any=False, device=device
            )

        return make

    def supports_discrete_actions(self) -> bool:
        """Return True: agents choose among lane actions, and only among these."""
        return True

    def has_render(self, env: EnvBase) -> bool:
        """Return False: `smarts-bench render` draws recorded episodes."""
        return False

    def max_steps(self, env: EnvBase) -> int:
        """Return the most decisions of an episode."""
        return self._max_steps

    def info_spec(self, env: EnvBase) -> Composite | None:
        """Return None."""
        return None

    @staticmethod
    def env_name() -> str:
        """Return the name under which BenchMARL groups results."""
        return "smarts"
