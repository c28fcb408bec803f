"""A custom metric: record episodes, then measure how often agents brake hard."""

import tempfile

import numpy as np

from benchmark.metrics import Measure, compute, measure_episodes, share
from smarts.env import hiway_parallel_env
from smarts.sim.assembly import Options


def measure(episode):
    """Return, for each agent, how often it began to brake harder than 3 m/s^2, and how long it drove [s]."""
    braked = np.zeros(episode.count)
    for agent in np.flatnonzero(episode.own >= 0):
        acceleration = episode.motion.acceleration[episode.driving[:, agent], episode.own[agent]]
        hard = acceleration < -3.0
        braked[agent] = np.count_nonzero(hard[1:] & ~hard[:-1])
    return {"own_hard_brakes": braked, "own_seconds": episode.duration}


HARD_BRAKES = Measure(
    name="hard_brakes_a_minute",
    label="Hard brakes a minute",
    meaning="how often agents begin to brake harder than 3 m/s^2, for each minute of driving",
    columns=("own_hard_brakes", "own_seconds"),
    measure=measure,
    value=lambda totals: 60 * share(totals["own_hard_brakes"], totals["own_seconds"]),
    count=("own_seconds",),
    counted="s of driving",
    missing="no agent drove",
    better="lower",
    is_share=False,
)


def main(episodes: int = 2) -> float:
    """Record, measure; return the value."""
    with tempfile.TemporaryDirectory() as folder:
        env = hiway_parallel_env(["intersection"], 4, simulation=Options(record=folder))
        for _ in range(episodes):
            env.reset()
            while env.agents:
                env.step(dict.fromkeys(env.agents, 0))
        env.close()
        name = "own_metric:HARD_BRAKES"
        table = measure_episodes(
            folder, labels={"algorithm": "keep_lane", "training_seed": 0}, metrics=[name]
        )
        (value,) = compute(table, ["algorithm"], metrics=[name])["value"]
    print(f"{value:.2f} hard brakes a minute")
    return value


if __name__ == "__main__":
    main()
