from pathlib import Path

from scenarios.drivers import IMPATIENT, MIXED, START_ON_A_ROAD, Drivers, flow, traffic
from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

WARM_UP = 15.0
FILLED = {"approach": 290}


def social(density: float = 1.0, drivers: Drivers = MIXED, lanes: int = 3) -> dict[str, t.Traffic]:
    flows = [
        flow(("approach", lane), ("narrowed", max(lane - 1, 0)), 720 * density, drivers)
        for lane in range(lanes)
    ]
    return traffic(flows, WARM_UP, FILLED)


missions = [
    t.Mission(t.Route(begin=("approach", 0, 130), end=("narrowed", 0, 60))),
    t.Mission(t.Route(begin=("approach", 0, 155), end=("narrowed", 0, 80))),
    t.Mission(t.Route(begin=("approach", 1, 140), end=("narrowed", 0, 100))),
]
late = [
    t.Mission(t.Route(begin=("approach", 0, 190), end=("narrowed", 1, 100))),
    t.Mission(t.Route(begin=("approach", 0, 215), end=("narrowed", 1, 100))),
    t.Mission(t.Route(begin=("approach", 2, 200), end=("narrowed", 0, 100))),
]

gen_scenario(
    t.Scenario(
        traffic=social(),
        ego_missions=missions,
        start_variation=START_ON_A_ROAD,
        held_out={
            "dense": t.Variation("More vehicles.", traffic=social(1.25)),
            "sparse_impatient": t.Variation("Fewer vehicles, all impatient.", traffic=social(0.6, IMPATIENT)),
            "late": t.Variation("The egos start closer to the lane's end.", ego_missions=late),
            "two_to_one": t.Variation(
                "Two lanes become one.",
                map_spec=t.MapSpec(source="two_to_one"),
                traffic=social(0.9, lanes=2),
            ),
        },
    ),
    output_dir=Path(__file__).parent,
)
