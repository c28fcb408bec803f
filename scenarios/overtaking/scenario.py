from pathlib import Path

from scenarios.drivers import IMPATIENT, MIXED, START_ON_A_ROAD, Drivers, flow, traffic
from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

WARM_UP = 15.0
FILLED = {"road": 580}
slow_truck = t.TrafficActor(
    name="slow_truck", vehicle_type="truck", max_speed=6.0, speed=t.Distribution(mean=1.0, sigma=0.0)
)


def social(density: float = 1.0, drivers: Drivers = MIXED, lanes: int = 2) -> dict[str, t.Traffic]:
    left = lanes - 1
    # Trucks are slow to spread along the road, so the first ones set out from all along it.
    trucks = [
        flow(("road", 0, offset), ("road", 0), 700 * density, {slow_truck: 1}, end=10.0)
        for offset in (90, 170, 250, 330, 410)
    ]
    flows = [
        *trucks,
        flow(("road", 0), ("road", 0), 150 * density, {slow_truck: 1}),
        flow(("road", 0), ("road", left), 350 * density, drivers),
        *(flow(("road", lane), ("road", lane), 900 * density, drivers) for lane in range(1, lanes)),
    ]
    return traffic(flows, WARM_UP, FILLED)


missions = [
    t.Mission(t.Route(begin=("road", 0, 60), end=("road", 0, 420))),
    t.Mission(t.Route(begin=("road", 0, 130), end=("road", 0, 470))),
]
from_the_left = [
    t.Mission(t.Route(begin=("road", 1, 60), end=("road", 0, 420))),
    t.Mission(t.Route(begin=("road", 0, 100), end=("road", 1, 470))),
]

gen_scenario(
    t.Scenario(
        traffic=social(),
        ego_missions=missions,
        start_variation=START_ON_A_ROAD,
        held_out={
            "dense": t.Variation("More vehicles.", traffic=social(1.25)),
            "sparse_impatient": t.Variation("Fewer vehicles, all impatient.", traffic=social(0.6, IMPATIENT)),
            "from_the_left": t.Variation("One ego starts in the fast lane.", ego_missions=from_the_left),
            "three_lanes": t.Variation(
                "Three lanes.",
                map_spec=t.MapSpec(source="three_lanes"),
                traffic=social(lanes=3),
            ),
        },
    ),
    output_dir=Path(__file__).parent,
)
