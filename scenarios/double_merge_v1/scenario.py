from pathlib import Path

from scenarios.benchmark import crossing_trades, weaving
from scenarios.drivers import ALL_KINDS, KINDS, START_IN_TOWN
from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

SLOW = 8.0
"""Speed of a normal vehicle ahead of the agents [m/s]."""

gen_scenario(
    t.Scenario(
        map_spec=t.MapSpec(source="../double_merge"),
        traffic=weaving(drivers=ALL_KINDS, slow=SLOW),
        ego_missions=crossing_trades(),
        start_variation=START_IN_TOWN,
        held_out={
            **{
                kind: t.Variation(f"All drivers {kind}.", traffic=weaving(drivers=drivers, slow=SLOW))
                for kind, drivers in KINDS.items()
            },
            "dense": t.Variation("More vehicles.", traffic=weaving(1.3, ALL_KINDS, slow=SLOW)),
            "all_cross": t.Variation("Every vehicle crosses.", traffic=weaving(1.0, ALL_KINDS, 1.0, SLOW)),
            "three_lanes": t.Variation(
                "A third lane in the middle of the weaving section.",
                map_spec=t.MapSpec(source="../double_merge/three_lanes"),
            ),
        },
    ),
    output_dir=Path(__file__).parent,
)
