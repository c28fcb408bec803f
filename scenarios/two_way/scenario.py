from pathlib import Path

from scenarios.drivers import IMPATIENT, MIXED, START_IN_TOWN, Drivers, flow, traffic
from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

WARM_UP = 20.0
FILLED = {"eastbound_approach": 115, "westbound_approach": 115}


def social(density: float = 1.0, drivers: Drivers = MIXED, lanes: int = 1) -> dict[str, t.Traffic]:
    flows = [
        flow((f"{way}_approach", lane), (f"{way}_exit", lane), 1150 * density / lanes, drivers)
        for way in ("eastbound", "westbound")
        for lane in range(lanes)
    ]
    return traffic(flows, WARM_UP, FILLED)


missions = [
    t.Mission(t.Route(begin=("westbound", 0, 5), end=("westbound", 0, 97))),
    t.Mission(t.Route(begin=("eastbound", 0, 5), end=("eastbound", 0, 97))),
    t.Mission(t.Route(begin=("westbound", 0, 20), end=("westbound", 0, 97))),
    t.Mission(t.Route(begin=("eastbound", 0, 20), end=("eastbound", 0, 97))),
]
platoon = [
    t.Mission(t.Route(begin=("eastbound_approach", 0, offset), end=("eastbound", 0, 97)))
    for offset in (60, 75, 90, 105)
]

gen_scenario(
    t.Scenario(
        traffic=social(),
        ego_missions=missions,
        start_variation=START_IN_TOWN,
        held_out={
            "dense": t.Variation("More vehicles.", traffic=social(1.35)),
            "sparse_impatient": t.Variation("Fewer vehicles, all impatient.", traffic=social(0.6, IMPATIENT)),
            "two_lanes": t.Variation(
                "Two lanes a direction.",
                map_spec=t.MapSpec(source="two_lanes"),
                traffic=social(1.5, lanes=2),
            ),
            "platoon": t.Variation("All egos eastbound, one behind the other.", ego_missions=platoon),
        },
    ),
    output_dir=Path(__file__).parent,
)
