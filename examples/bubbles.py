"""Traffic flows into a bubble, agents of the zoo drive its vehicles inside, and they flow on as traffic.

An argument names a folder for the recorded episode, which `smarts-bench render` draws.
"""

import sys
import tempfile
from collections import Counter
from pathlib import Path

from smarts.env import SingleHiWayEnv
from smarts.sim.assembly import Options
from smarts.sim.episode_files import RecordedEpisode, episodes_in
from smarts.types.transfers import Reason

SCENARIO = Path(__file__).parent / "bubble_junction"


def main(folder: str) -> dict[str, int]:
    """Play an episode and record it in a folder; return how many vehicles changed hands, by reason."""
    env = SingleHiWayEnv([SCENARIO], simulation=Options(record=folder))
    try:
        env.reset(seed=42)
        is_over, info = False, {}
        while not is_over:
            _, _, terminated, truncated, info = env.step(0)  # keep the lane
            is_over = terminated or truncated
    finally:
        env.close()
    episode = RecordedEpisode(episodes_in(folder)[0])
    reasons = Counter(episode.table("transfers")["reason"].tolist())
    counts = {each.name.lower(): reasons[each] for each in (Reason.SHADOW, Reason.TAKE, Reason.RELEASE)}
    print(f"the ego: {info['outcome']}; vehicles:", ", ".join(f"{n} {name}" for name, n in counts.items()))
    holds = episode.table("holds")
    first = holds["policy"].tolist().index("driver")
    steps = f"{holds['first_step'][first]} to {holds['last_step'][first]}"
    print(f"{holds['name'][first]} had its vehicle in steps {steps}")
    return counts


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as temporary:
        main(sys.argv[1] if len(sys.argv) > 1 else temporary)
