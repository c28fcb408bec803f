from pathlib import Path

from scenarios.drivers import IMPATIENT, MIXED, START_IN_TOWN, Drivers, flow, traffic
from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

WARM_UP = 20.0
FILLED = {"arterial": 300}


def social(density: float = 1.0, drivers: Drivers = MIXED, lanes: int = 2) -> dict[str, t.Traffic]:
    leaving = flow(("arterial", 0), ("slip_road", 0), 800 * density, drivers)
    late = flow(("arterial", 1), ("slip_road", 0), 150 * density, drivers)
    through = [
        flow(("arterial", lane), ("arterial_out", lane - 1), 850 * density, drivers)
        for lane in range(1, lanes)
    ]
    flows = [leaving, late, *through]
    return traffic(flows, WARM_UP, FILLED)


missions = [
    t.Mission(t.Route(begin=("arterial", 1, 120), end=("slip_road", 0, 50))),
    t.Mission(t.Route(begin=("arterial", 0, 110), end=("slip_road", 0, 70))),
    t.Mission(t.Route(begin=("arterial", 0, 80), end=("arterial_out", 0, 60))),
]
late = [
    t.Mission(t.Route(begin=("arterial", 1, 190), end=("slip_road", 0, 50))),
    t.Mission(t.Route(begin=("arterial", 1, 160), end=("slip_road", 0, 50))),
    t.Mission(t.Route(begin=("arterial", 0, 150), end=("arterial_out", 0, 60))),
]

gen_scenario(
    t.Scenario(
        traffic=social(),
        ego_missions=missions,
        start_variation=START_IN_TOWN,
        held_out={
            "dense": t.Variation("More vehicles.", traffic=social(1.2)),
            "sparse_impatient": t.Variation("Fewer vehicles, all impatient.", traffic=social(0.6, IMPATIENT)),
            "late": t.Variation("The egos start closer to the slip road.", ego_missions=late),
            "three_lanes": t.Variation(
                "Three lanes.",
                map_spec=t.MapSpec(source="three_lanes"),
                traffic=social(lanes=3),
            ),
        },
    ),
    output_dir=Path(__file__).parent,
)
