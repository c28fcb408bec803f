from pathlib import Path

from scenarios.benchmark import FROM_ALL_SIDES, LEFT_TURNS, MIRRORED, ON_THREE_LANES, farther, four_arms
from scenarios.drivers import ALL_KINDS, KINDS, START_IN_TOWN
from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

DENSITY = 0.75
"""Multiple of the paper's scenario's."""
LATER = {"north_in": 10, "south_in": 10}
"""Where agents on the road with priority start [m]: 44 m before the crossing, with time to see each other."""

gen_scenario(
    t.Scenario(
        map_spec=t.MapSpec(source="../intersection"),
        traffic=four_arms(DENSITY, ALL_KINDS),
        ego_missions=farther(FROM_ALL_SIDES, starts=LATER),
        start_variation=START_IN_TOWN,
        held_out={
            **{
                kind: t.Variation(f"All drivers {kind}.", traffic=four_arms(DENSITY, drivers))
                for kind, drivers in KINDS.items()
            },
            "dense": t.Variation("More vehicles.", traffic=four_arms(1.25 * DENSITY, ALL_KINDS)),
            "mirrored": t.Variation(
                "The missions, turned by 180 degrees.", ego_missions=farther(MIRRORED, starts=LATER)
            ),
            "left_turns": t.Variation(
                "Every ego turns left, among fewer vehicles.",
                traffic=four_arms(0.65 * DENSITY, ALL_KINDS),
                ego_missions=farther(LEFT_TURNS, starts=LATER),
            ),
            "three_lanes": t.Variation(
                "Three lanes a direction.",
                map_spec=t.MapSpec(source="../intersection/three_lanes"),
                traffic=four_arms(DENSITY, ALL_KINDS, 3),
                ego_missions=farther(ON_THREE_LANES, starts=LATER),
            ),
        },
    ),
    output_dir=Path(__file__).parent,
)
