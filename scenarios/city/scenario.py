from pathlib import Path

from scenarios.drivers import IMPATIENT, MIXED, START_IN_TOWN, Drivers, traffic
from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

WARM_UP = 20.0
ROUTES = 160
RUSH = 8.0
"""Within which the town fills [s]."""


def social(density: float = 1.0, drivers: Drivers = MIXED) -> dict[str, t.Traffic]:
    flows = []
    for _ in range(ROUTES):
        route = t.RandomRoute()
        for rate, end in ((1200, RUSH), (28, 3600)):
            flows.append(
                t.Flow(route=route, rate=rate * density, end=end, actors=drivers, randomly_spaced=True)
            )
    return traffic(flows, WARM_UP)


missions = [
    t.Mission(t.Route(begin=("B1C1", 0, 30), end=("E3E4", 0, 60))),
    t.Mission(t.Route(begin=("E4D4", 0, 40), end=("B2B1", 0, 60))),
    t.Mission(t.Route(begin=("F1F2", 0, 30), end=("C3B3", 0, 60))),
    t.Mission(t.Route(begin=("B4B3", 0, 30), end=("E1F1", 0, 60))),
]
suburbs = [
    t.Mission(t.Route(begin=("A1B1", 0, 30), end=("C4C5", 0, 50))),
    t.Mission(t.Route(begin=("G3F3", 0, 30), end=("D1D0", 0, 50))),
    t.Mission(t.Route(begin=("E5E4", 0, 30), end=("F2G2", 0, 50))),
    t.Mission(t.Route(begin=("C0C1", 0, 30), end=("B3A3", 0, 50))),
]

gen_scenario(
    t.Scenario(
        traffic=social(),
        ego_missions=missions,
        start_variation=START_IN_TOWN,
        held_out={
            "dense": t.Variation("More vehicles.", traffic=social(1.2)),
            "sparse_impatient": t.Variation("Fewer vehicles, all impatient.", traffic=social(0.6, IMPATIENT)),
            "suburbs": t.Variation("Missions from and to the edge of the town.", ego_missions=suburbs),
        },
    ),
    output_dir=Path(__file__).parent,
)
