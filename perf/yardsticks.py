"""Scores on games of other publications: level-based foraging, simple_spread, random matrices.

    python -m perf.yardsticks [--games foraging spread matrices] [--algorithms vdn ppo ...] [--seeds 1 2 3]
    python -m perf.yardsticks --page

Trains each algorithm on each game for which there is a recipe (`perf/yardstick_games/recipes.py`), one run
after another, and evaluates it 20 times, greedily and sampled. Each run writes its curve below
results/yardsticks (`--out`), then the page and the picture are made again. Runs whose file is there are left
out: the same command resumes, and trains an interrupted run again from its beginning.
"""

from __future__ import annotations

import argparse
import json
import logging
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from perf.yardstick_games import results
from perf.yardstick_games.recipes import RECIPES, YARDSTICKS, Recipe
from perf.yardstick_games.results import RANDOM, SEED, Evaluation, RunFile

if TYPE_CHECKING:
    from algorithms.joint.sampler import EvaluatedStep

EVALUATIONS, EPISODES, RANDOM_EPISODES = 20, 200, 2_000
EVALUATION_SEED = 20
"""Of the episodes of all evaluations, whatever the training's seed."""


def origin() -> dict[str, str]:
    """Return the command and the commit, with a "+" if files differ from it."""
    root = Path(__file__).resolve().parents[1]
    described = ["git", "describe", "--always", "--dirty=+", "--exclude=*"]
    commit = subprocess.run(described, cwd=root, capture_output=True, text=True, check=False).stdout.strip()
    return {"command": " ".join(["python -m perf.yardsticks", *sys.argv[1:]]), "commit": commit}


ORIGIN = origin()
"""Of all runs of this process: their code is that of its start."""


def trained(game: str, algorithm: str, seed: int, steps: int, episodes: int) -> RunFile:
    """Train and evaluate; return the run."""
    recipe = RECIPES[game][algorithm]
    algo = built(game, algorithm, seed, recipe)
    curve, seconds, done = [evaluated(game, algo, episodes, 0, 0.0)], 0.0, 0
    while done < steps:
        start = time.process_time()
        algo.train()
        seconds += time.process_time() - start
        done += recipe.num_envs * recipe.fragment
        if done >= min(len(curve) * steps / EVALUATIONS, steps):
            curve.append(evaluated(game, algo, episodes, done, seconds))
            print(f"{game} {algorithm} seed {seed}: {shown(curve[-1])}", flush=True)
    algo.stop()
    about = {
        **ORIGIN,
        SEED: EVALUATION_SEED,
        "num_envs": recipe.num_envs,
        "fragment": recipe.fragment,
        "limit_ends": recipe.limit_ends,
        "settings": recipe.settings,
    }
    return RunFile(game, algorithm, seed, about, curve)


def built(game: str, algorithm: str, seed: int, recipe: Recipe) -> Any:
    """Return the algorithm."""
    return configured(game, algorithm, seed, recipe).build_algo()


def configured(game: str, algorithm: str, seed: int, recipe: Recipe) -> Any:
    """Return the algorithm's configuration."""
    from ray.tune import register_env

    import algorithms

    register_env(game, lambda config: YARDSTICKS[game].make(config["num_envs"], limit_ends=recipe.limit_ends))
    config = algorithms.config(algorithm.partition("-")[0]).environment(game).debugging(seed=seed)
    config.env_runners(
        num_env_runners=0, num_envs_per_env_runner=recipe.num_envs, rollout_fragment_length=recipe.fragment
    )
    return config.training(**recipe.settings)


def evaluated(game: str, algo: Any, episodes: int, steps: int, seconds: float) -> Evaluation:
    """Return mean scores, greedy and sampled."""
    from algorithms.joint.evaluation import evaluate

    loops, score = Loops(), YARDSTICKS[game].score
    greedy = evaluate(algo, episodes, on_step=loops, seed=EVALUATION_SEED)
    sampled = evaluate(algo, episodes, explore=True, seed=EVALUATION_SEED)
    means = [score(float(np.mean([e.returns.sum() for e in played]))) for played in (greedy, sampled)]
    return Evaluation(steps, means[0], means[1], len(loops.looped) / episodes, seconds)


class Loops:
    """Collects the episodes in which all agents see again what they saw before.

    These games are deterministic, so a greedy team without memory repeats from there what it did, for ever.
    """

    def __init__(self) -> None:
        self.looped: set[int] = set()
        self._seen: set[tuple[int, bytes]] = set()

    def __call__(self, step: EvaluatedStep) -> None:
        """Take note of what the agents of each environment see."""
        (leaves,) = step.view.observations
        for row, episode in enumerate(step.playing.tolist()):
            key = episode, leaves[""][row].tobytes()
            if episode >= 0 and key in self._seen:
                self.looped.add(episode)
            self._seen.add(key)


def random_play(game: str, seed: int, episodes: int) -> RunFile:
    """Return the score of uniformly random actions, over the first episode of each of `episodes` copies."""
    env = YARDSTICKS[game].make(episodes)
    rng = np.random.Generator(np.random.Philox(seed))
    env.reset(seed, np.arange(episodes))
    total, playing = np.zeros(episodes), np.ones(episodes, bool)
    while playing.any():
        step = env.step((rng.integers(env.num_actions, size=(episodes, env.num_agents)),))
        total += np.where(playing, step.rewards.sum(1), 0)
        playing &= ~step.reset
    score = YARDSTICKS[game].score(float(total.mean()))
    return RunFile(
        game, RANDOM, seed, {**ORIGIN, "episodes": episodes}, [Evaluation(0, np.nan, score, np.nan, 0.0)]
    )


def shown(evaluation: Evaluation) -> str:
    """Return an evaluation in words."""
    return (
        f"{evaluation.steps:>9,} steps  greedy {evaluation.greedy:8.3f}  sampled {evaluation.sampled:8.3f}"
        f"  {evaluation.seconds:6.0f} s"
    )


def jobs(arguments: argparse.Namespace) -> list[tuple[str, str, int]]:
    """Return the (game, algorithm, seed) that are asked for and are not there yet, seed by seed."""
    wanted = [
        (game, name, seed)
        for seed in arguments.seeds
        for game in arguments.games
        for name in RECIPES[game]
        if name in (arguments.algorithms or RECIPES[game])
    ]
    return [job for job in wanted if not results.file_of(arguments.out, *job).exists()]


def train_all(arguments: argparse.Namespace, wanted: Sequence[tuple[str, str, int]]) -> None:
    """Train what is missing, one run after another."""
    import ray
    import torch

    logging.getLogger("ray").setLevel(logging.ERROR)
    torch.set_num_threads(1)
    ray.init(address="local", num_cpus=1, include_dashboard=False, logging_level=logging.ERROR)
    for game, algorithm, seed in wanted:
        steps = arguments.steps or RECIPES[game][algorithm].steps or YARDSTICKS[game].steps
        results.write(arguments.out, trained(game, algorithm, seed, steps, arguments.episodes))
        write_page(arguments.out)
    ray.shutdown()


def write_page(folder: Path) -> None:
    """Write the page and the picture."""
    results.draw(folder)
    (folder / "README.md").write_text(results.page(folder))


def parsed() -> argparse.Namespace:
    """Return the command line's arguments."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    known = list(dict.fromkeys(name for recipes in RECIPES.values() for name in recipes))
    parser.add_argument("--games", nargs="+", default=list(YARDSTICKS), choices=list(YARDSTICKS))
    parser.add_argument("--algorithms", nargs="+", choices=known, help="default: all with a recipe")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--steps", type=int, help="environment steps of each run (default: the game's)")
    parser.add_argument("--episodes", type=int, default=EPISODES, help="of each evaluation")
    parser.add_argument("--out", type=Path, default=results.FOLDER)
    parser.add_argument("--page", action="store_true", help="only make the page again")
    return parser.parse_args()


def main() -> None:
    """Train what is missing and write the page."""
    arguments = parsed()
    wanted = [] if arguments.page else jobs(arguments)
    for game in [] if arguments.page else arguments.games:
        if not results.file_of(arguments.out, game, RANDOM, 1).exists():
            results.write(arguments.out, random_play(game, 1, RANDOM_EPISODES))
    if wanted:
        print(f"{len(wanted)} runs: {json.dumps(wanted)}", flush=True)
        train_all(arguments, wanted)
    write_page(arguments.out)
    print(f"wrote {arguments.out / 'README.md'}")


if __name__ == "__main__":
    main()
