"""`python -m benchmark.floors`: how floor policies end in the benchmark's scenarios."""

from __future__ import annotations

import argparse

from benchmark.floors import FLOORS
from benchmark.floors.run import play

SCENARIOS = ("two_way", "double_merge", "intersection")
SHOWN = ("collision", "goal", "off_road", "off_route", "missed_goal", "not_moving", "time_out")


def main() -> None:
    """Play, and print a line for each policy, scenario and traffic."""
    parser = argparse.ArgumentParser(prog="python -m benchmark.floors", description=__doc__)
    parser.add_argument("policies", nargs="*", default=[*FLOORS], help="; ".join(FLOORS))
    parser.add_argument("--scenarios", nargs="*", default=SCENARIOS)
    parser.add_argument("--episodes", type=int, default=20, help="of each policy and scenario")
    parser.add_argument("--seed", type=int, default=42)
    given = parser.parse_args()
    print(f"{'policy':<10}{'scenario':<14}{'traffic':<24}{'episodes':>9}{'s':>6}", end="")
    print("".join(f"{name:>12}" for name in SHOWN))
    for policy in given.policies:
        for scenario in given.scenarios:
            for tally in play(policy, scenario, episodes=given.episodes, seed=given.seed):
                seconds = 0.1 * tally.steps / tally.episodes
                print(f"{policy:<10}{scenario:<14}{tally.traffic:<24}", end="")
                print(f"{tally.episodes:>9}{seconds:>6.0f}", end="")
                print("".join(f"{tally.share(name):>12.2f}" for name in SHOWN), flush=True)


if __name__ == "__main__":
    main()
