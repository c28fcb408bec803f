"""Cut-in ratio: lane changes after which the vehicle behind is left with less than 1 s."""

from benchmark.metrics.episode_data import EpisodeData
from benchmark.metrics.lane_changes import find_lane_changes
from benchmark.metrics.measure import Columns, Measure, share


def measure(episode: EpisodeData) -> Columns:
    """Return cut-ins and completed lane changes."""
    changes = episode.shared(find_lane_changes)
    return {"cut_ins": changes.cut_ins.astype(float), "lane_changes": changes.completed.astype(float)}


METRIC = Measure(
    name="cut_in_ratio",
    label="Cut-in ratio",
    meaning="lane changes that leave the vehicle behind less than 1.0 s of headway / completed lane changes",
    columns=("cut_ins", "lane_changes"),
    measure=measure,
    value=lambda totals: share(totals["cut_ins"], totals["lane_changes"]),
    hits="cut_ins",
    count=("lane_changes",),
    counted="lane changes",
    missing="no lane change was completed",
    better="lower",
)
