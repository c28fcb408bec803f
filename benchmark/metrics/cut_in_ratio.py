"""Cut-in ratio: lane changes after which the vehicle behind is left with less than 1 s."""

from benchmark.metrics.episode_data import EpisodeData
from benchmark.metrics.lane_changes import find_lane_changes
from benchmark.metrics.measure import Columns, ratio


def measure(episode: EpisodeData) -> Columns:
    """Return cut-ins and completed lane changes."""
    changes = episode.shared(find_lane_changes)
    return {"cut_ins": changes.cut_ins.astype(float), "lane_changes": changes.completed.astype(float)}


METRIC = ratio(
    "cut_ins",
    "lane_changes",
    is_count=True,
    name="cut_in_ratio",
    label="Cut-in ratio",
    meaning="lane changes that leave the vehicle behind less than 1.0 s of headway / completed lane changes",
    measure=measure,
    counted="lane changes",
    missing="no lane change was completed",
    better="lower",
)
