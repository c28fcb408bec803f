from pathlib import Path

from scenarios.benchmark import crossing_trades, weaving
from scenarios.drivers import IMPATIENT, START_IN_TOWN
from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

gen_scenario(
    t.Scenario(
        traffic=weaving(),
        ego_missions=crossing_trades(),
        start_variation=START_IN_TOWN,
        held_out={
            "dense": t.Variation("More vehicles.", traffic=weaving(1.3)),
            "sparse_impatient": t.Variation(
                "Fewer vehicles, all impatient.", traffic=weaving(0.6, IMPATIENT)
            ),
            "all_cross": t.Variation("Every vehicle crosses.", traffic=weaving(crossing=1)),
            "three_lanes": t.Variation(
                "A third lane in the middle of the weaving section.",
                map_spec=t.MapSpec(source="three_lanes"),
            ),
        },
    ),
    output_dir=Path(__file__).parent,
)
