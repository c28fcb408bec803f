from pathlib import Path

from scenarios.drivers import IMPATIENT, MIXED, START_ON_A_FAST_ROAD, Drivers, flow, traffic
from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

WARM_UP = 20.0
FILLED = {"main_in": 270, "ramp": 170}


def social(density: float = 1.0, drivers: Drivers = MIXED, lanes: int = 2) -> dict[str, t.Traffic]:
    ramp = flow(("ramp", 0), ("main_out", 0), 350 * density, drivers)
    main = [flow(("main_in", lane), ("main_out", lane), 1100 * density, drivers) for lane in range(lanes)]
    flows = [ramp, *main]
    return traffic(flows, WARM_UP, FILLED)


missions = [
    t.Mission(t.Route(begin=("ramp", 0, 130), end=("main_out", 0, 60))),
    t.Mission(t.Route(begin=("ramp", 0, 105), end=("main_out", 0, 90))),
    t.Mission(t.Route(begin=("main_in", 0, 190), end=("main_out", 0, 120))),
]
to_the_left = [
    t.Mission(t.Route(begin=("ramp", 0, 130), end=("main_out", 1, 90))),
    t.Mission(t.Route(begin=("ramp", 0, 105), end=("main_out", 1, 120))),
    t.Mission(t.Route(begin=("main_in", 1, 190), end=("main_out", 0, 120))),
]

gen_scenario(
    t.Scenario(
        traffic=social(),
        ego_missions=missions,
        start_variation=START_ON_A_FAST_ROAD,
        held_out={
            "dense": t.Variation("More vehicles.", traffic=social(1.2)),
            "sparse_impatient": t.Variation("Fewer vehicles, all impatient.", traffic=social(0.6, IMPATIENT)),
            "to_the_left": t.Variation("The goals lie in the left lane.", ego_missions=to_the_left),
            "short_lane": t.Variation(
                "An acceleration lane of 110 m.", map_spec=t.MapSpec(source="short_lane")
            ),
            "three_lanes": t.Variation(
                "Three lanes on the main road.",
                map_spec=t.MapSpec(source="three_lanes"),
                traffic=social(lanes=3),
            ),
        },
    ),
    output_dir=Path(__file__).parent,
)
