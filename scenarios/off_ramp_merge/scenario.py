from pathlib import Path

from scenarios.drivers import IMPATIENT, MIXED, START_ON_A_FAST_ROAD, Drivers, flow, traffic
from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

WARM_UP = 20.0
FILLED = {"main_in": 250}


def social(density: float = 1.0, drivers: Drivers = MIXED, lanes: int = 2) -> dict[str, t.Traffic]:
    leaving = [flow(("main_in", lane), ("ramp", 0), 350 * density, drivers) for lane in (0, 1)]
    staying = [flow(("main_in", lane), ("main_out", lane), 850 * density, drivers) for lane in range(lanes)]
    flows = [*leaving, *staying]
    return traffic(flows, WARM_UP, FILLED)


missions = [
    t.Mission(t.Route(begin=("main_in", 1, 150), end=("ramp", 0, 60))),
    t.Mission(t.Route(begin=("main_in", 0, 170), end=("ramp", 0, 80))),
    t.Mission(t.Route(begin=("main_in", 0, 130), end=("main_out", 0, 60))),
]
late = [
    t.Mission(t.Route(begin=("main_in", 1, 200), end=("ramp", 0, 60))),
    t.Mission(t.Route(begin=("main_in", 1, 225), end=("ramp", 0, 80))),
    t.Mission(t.Route(begin=("main_in", 0, 210), end=("main_out", 1, 60))),
]

gen_scenario(
    t.Scenario(
        traffic=social(),
        ego_missions=missions,
        start_variation=START_ON_A_FAST_ROAD,
        held_out={
            "dense": t.Variation("More vehicles.", traffic=social(1.2)),
            "sparse_impatient": t.Variation("Fewer vehicles, all impatient.", traffic=social(0.6, IMPATIENT)),
            "late": t.Variation("The egos start closer to the exit.", ego_missions=late),
            "three_lanes": t.Variation(
                "Three lanes on the main road.",
                map_spec=t.MapSpec(source="three_lanes"),
                traffic=social(lanes=3),
            ),
        },
    ),
    output_dir=Path(__file__).parent,
)
