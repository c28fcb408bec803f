"""Scores on games of other publications: level-based foraging, simple_spread, random matrices.

    python -m perf.yardsticks [--games foraging spread matrices] [--algorithms vdn ppo ...] [--seeds 1 2 3]

Trains each algorithm on each game for which there is a recipe (`perf/yardstick_games/recipes.py`), one run
after another, and evaluates it 20 times, greedily and sampled. Each run writes its curve
below results/yardsticks (`--out`). Runs whose file is there are left out: the same command resumes, and
trains an interrupted run again from its beginning.
"""

from __future__ import annotations

import argparse
import csv
import io
import json
import logging
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from algorithms.joint.env import Ints, JointStep
from perf.yardstick_games.recipes import RECIPES, YARDSTICKS, Recipe
from perf.yardstick_games.vector import VectorGame

FOLDER = Path(__file__).resolve().parents[1] / "results" / "yardsticks"
RANDOM = "random"
EVALUATIONS, EPISODES, RANDOM_EPISODES = 20, 200, 2_000
EVALUATION_SEED = 20
"""Seed of the episodes of all evaluations, whatever the training's seed."""


class Evaluation(NamedTuple):
    """Mean scores after so many environment steps.

    Attributes:
        steps: Environment steps of training.
        greedy: Score of greedy play, NaN for random play.
        sampled: Score of play as in training.
        looped: Share of the greedy episodes in which all agents saw again what they had seen before.
        seconds: Processor time of the training so far [s].
    """

    steps: int
    greedy: float
    sampled: float
    looped: float
    seconds: float


class RunFile(NamedTuple):
    """A run: what made it, and its curve.

    Attributes:
        game: Name of the game.
        algorithm: Name of the algorithm, or "random".
        seed: Of the training.
        about: Command, commit and settings.
        curve: Evaluations, the last at the end of the training.
    """

    game: str
    algorithm: str
    seed: int
    about: Mapping[str, Any]
    curve: list[Evaluation]


def file_of(folder: Path, game: str, algorithm: str, seed: int) -> Path:
    """Return where a run lies."""
    return folder / game / f"{algorithm}_{seed}.csv"


def write(folder: Path, run: RunFile) -> None:
    """Write a run; a file is never half written."""
    out = io.StringIO()
    out.write(f"# {json.dumps(dict(run.about))}\n")
    rows = csv.writer(out, lineterminator="\n")
    rows.writerow(Evaluation._fields)
    rows.writerows(
        [e.steps, f"{e.greedy:.4f}", f"{e.sampled:.4f}", f"{e.looped:.3f}", f"{e.seconds:.0f}"]
        for e in run.curve
    )
    file = file_of(folder, run.game, run.algorithm, run.seed)
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_suffix(".part")
    part.write_text(out.getvalue())
    part.replace(file)


def origin() -> dict[str, str]:
    """Return the command and the commit, with a "+" if files differ from it."""
    root = Path(__file__).resolve().parents[1]
    described = ["git", "describe", "--always", "--dirty=+", "--exclude=*"]
    commit = subprocess.run(described, cwd=root, capture_output=True, text=True, check=False).stdout.strip()
    return {"command": " ".join(["python -m perf.yardsticks", *sys.argv[1:]]), "commit": commit}


ORIGIN = origin()
"""Origin of all runs of this process: their code is that of its start."""


def trained(game: str, algorithm: str, seed: int, steps: int, episodes: int) -> RunFile:
    """Train and evaluate; return the run."""
    recipe = RECIPES[game][algorithm]
    algo = configured(game, algorithm, seed, recipe).build_algo()
    curve, seconds, done = [evaluated(game, algo, recipe, episodes, 0, 0.0)], 0.0, 0
    while done < steps:
        start = time.process_time()
        algo.train()
        seconds += time.process_time() - start
        done += recipe.num_envs * recipe.fragment
        if done >= min(len(curve) * steps / EVALUATIONS, steps):
            curve.append(evaluated(game, algo, recipe, episodes, done, seconds))
            print(f"{game} {algorithm} seed {seed}: {shown(curve[-1])}", flush=True)
    algo.stop()
    about = {
        **ORIGIN,
        "evaluation_seed": EVALUATION_SEED,
        "num_envs": recipe.num_envs,
        "fragment": recipe.fragment,
        "limit_ends": recipe.limit_ends,
        "settings": recipe.settings,
    }
    return RunFile(game, algorithm, seed, about, curve)


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


def evaluated(game: str, algo: Any, recipe: Recipe, episodes: int, steps: int, seconds: float) -> Evaluation:
    """Return mean scores, greedy and sampled."""
    from algorithms.joint.evaluation import evaluate

    score = YARDSTICKS[game].score
    loops: Any = Loops(YARDSTICKS[game].make(recipe.num_envs, limit_ends=recipe.limit_ends))
    greedy = evaluate(algo, episodes, env=loops, seed=EVALUATION_SEED)
    sampled = evaluate(algo, episodes, explore=True, seed=EVALUATION_SEED)
    means = [score(float(np.mean([e.returns.sum() for e in played]))) for played in (greedy, sampled)]
    looped = loops.looped & {each.episode_index for each in greedy}
    return Evaluation(steps, means[0], means[1], len(looped) / episodes, seconds)


class Loops:
    """An environment that collects the episodes in which all agents see again what they saw before.

    These games are deterministic, so a greedy team without memory repeats from there what it did, for ever.
    """

    def __init__(self, env: VectorGame) -> None:
        self._env = env
        self.looped: set[int] = set()
        self._seen: set[tuple[int, bytes]] = set()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._env, name)

    def reset(self, seed: int, indices: Ints, *, stride: int = 0) -> JointStep:
        """Start all copies."""
        return self._noted(self._env.reset(seed, indices, stride=stride))

    def step(self, actions: tuple[np.ndarray, ...]) -> JointStep:
        """Act in all copies."""
        return self._noted(self._env.step(actions))

    def _noted(self, step: JointStep) -> JointStep:
        (leaves,) = step.observations
        for row, episode in enumerate(self._env.worlds.tolist()):
            key = episode, leaves[""][row].tobytes()
            if key in self._seen:
                self.looped.add(episode)
            self._seen.add(key)
        return step


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
    return [job for job in wanted if not file_of(arguments.out, *job).exists()]


def train_all(arguments: argparse.Namespace, wanted: Sequence[tuple[str, str, int]]) -> None:
    """Train what is missing, one run after another."""
    import ray
    import torch

    logging.getLogger("ray").setLevel(logging.ERROR)
    torch.set_num_threads(1)
    ray.init(address="local", num_cpus=1, include_dashboard=False, logging_level=logging.ERROR)
    for game, algorithm, seed in wanted:
        steps = arguments.steps or YARDSTICKS[game].steps
        write(arguments.out, trained(game, algorithm, seed, steps, arguments.episodes))
    ray.shutdown()


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
    parser.add_argument("--out", type=Path, default=FOLDER)
    return parser.parse_args()


def main() -> None:
    """Train what is missing."""
    arguments = parsed()
    wanted = jobs(arguments)
    for game in arguments.games:
        if not file_of(arguments.out, game, RANDOM, 1).exists():
            write(arguments.out, random_play(game, 1, RANDOM_EPISODES))
    if wanted:
        print(f"{len(wanted)} runs: {json.dumps(wanted)}", flush=True)
        train_all(arguments, wanted)


if __name__ == "__main__":
    main()
