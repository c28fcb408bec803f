from pathlib import Path

from scenarios.benchmark import FROM_ALL_SIDES, LEFT_TURNS, MIRRORED, ON_THREE_LANES, four_arms
from scenarios.drivers import IMPATIENT, START_IN_TOWN
from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

gen_scenario(
    t.Scenario(
        traffic=four_arms(),
        ego_missions=FROM_ALL_SIDES,
        start_variation=START_IN_TOWN,
        held_out={
            "dense": t.Variation("More vehicles.", traffic=four_arms(1.12)),
            "sparse_impatient": t.Variation(
                "Fewer vehicles, all impatient.", traffic=four_arms(0.6, IMPATIENT)
            ),
            "mirrored": t.Variation("The missions, turned by 180 degrees.", ego_missions=MIRRORED),
            "left_turns": t.Variation(
                "Every ego turns left, among fewer vehicles.",
                traffic=four_arms(0.65),
                ego_missions=LEFT_TURNS,
            ),
            "three_lanes": t.Variation(
                "Three lanes a direction.",
                map_spec=t.MapSpec(source="three_lanes"),
                traffic=four_arms(lanes=3),
                ego_missions=ON_THREE_LANES,
            ),
        },
    ),
    output_dir=Path(__file__).parent,
)
