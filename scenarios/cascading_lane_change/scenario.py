from pathlib import Path

from scenarios.drivers import IMPATIENT, MIXED, START_ON_A_ROAD, Drivers, flow, traffic
from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

WARM_UP = 15.0
FILLED = {"road": 400}


def social(density: float = 1.0, drivers: Drivers = MIXED, lanes: int = 4) -> dict[str, t.Traffic]:
    staying = [
        flow(("road", lane), ("road_out", max(lane - 1, 0)), 450 * density, drivers) for lane in range(lanes)
    ]
    leaving = [flow(("road", lane), ("exit", 0), 100 * density, drivers) for lane in range(lanes)]
    flows = [*staying, *leaving]
    return traffic(flows, WARM_UP, FILLED)


def missions(lanes: int = 4, offset: float = 60) -> list[t.Mission]:
    left = lanes - 1
    return [
        t.Mission(t.Route(begin=("road", left, offset), end=("exit", 0, 40))),
        t.Mission(t.Route(begin=("road", left, offset + 25), end=("exit", 0, 60))),
        t.Mission(t.Route(begin=("road", 0, offset + 10), end=("road_out", left - 1, 80))),
    ]


gen_scenario(
    t.Scenario(
        traffic=social(),
        ego_missions=missions(),
        start_variation=START_ON_A_ROAD,
        held_out={
            "dense": t.Variation("More vehicles.", traffic=social(1.3)),
            "sparse_impatient": t.Variation("Fewer vehicles, all impatient.", traffic=social(0.6, IMPATIENT)),
            "late": t.Variation("100 m less to cross the road in.", ego_missions=missions(offset=160)),
            "five_lanes": t.Variation(
                "Five lanes.",
                map_spec=t.MapSpec(source="five_lanes"),
                traffic=social(lanes=5),
                ego_missions=missions(lanes=5),
            ),
        },
    ),
    output_dir=Path(__file__).parent,
)
