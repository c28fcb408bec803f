from pathlib import Path

from scenarios.drivers import IMPATIENT, MIXED, START_IN_TOWN, Drivers, flow, traffic
from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

WARM_UP = 15.0
FILLED = {"eastbound_in": 135, "westbound_in": 210}


def social(density: float = 1.0, drivers: Drivers = MIXED, lanes: int = 2) -> dict[str, t.Traffic]:
    turning = flow(("eastbound_in", lanes - 1), ("westbound_out", lanes - 2), 120 * density, drivers)
    eastbound = [
        flow(("eastbound_in", lane), ("eastbound_out", lane), 1200 * density / lanes, drivers)
        for lane in range(lanes)
    ]
    westbound = [
        flow(("westbound_in", lane), ("westbound_out", lane), 900 * density / lanes, drivers)
        for lane in range(lanes)
    ]
    flows = [turning, *eastbound, *westbound]
    return traffic(flows, WARM_UP, FILLED)


def missions(lanes: int = 2) -> list[t.Mission]:
    left = lanes - 1
    return [
        t.Mission(t.Route(begin=("eastbound_in", left, 105), end=("westbound_out", left - 1, 80))),
        t.Mission(t.Route(begin=("eastbound_bay", left + 1, 35), end=("westbound_out", left, 110))),
        t.Mission(t.Route(begin=("westbound_in", left, 130), end=("westbound_out", left, 140))),
    ]


queue = [
    t.Mission(t.Route(begin=("eastbound_bay", 2, offset), end=("westbound_out", 0, 80)))
    for offset in (15, 30, 45)
]

gen_scenario(
    t.Scenario(
        traffic=social(),
        ego_missions=missions(),
        start_variation=START_IN_TOWN,
        held_out={
            "dense": t.Variation("More vehicles.", traffic=social(1.3)),
            "sparse_impatient": t.Variation("Fewer vehicles, all impatient.", traffic=social(0.6, IMPATIENT)),
            "queue": t.Variation("Three egos wait in the bay.", ego_missions=queue),
            "three_lanes": t.Variation(
                "Three lanes a direction.",
                map_spec=t.MapSpec(source="three_lanes"),
                traffic=social(1.2, lanes=3),
                ego_missions=missions(lanes=3),
            ),
        },
    ),
    output_dir=Path(__file__).parent,
)
