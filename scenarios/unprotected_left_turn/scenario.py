from pathlib import Path

from scenarios.drivers import IMPATIENT, MIXED, START_IN_TOWN, Drivers, flow, traffic
from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

WARM_UP = 20.0
FILLED = {"west_in": 130, "east_in": 130}


def social(density: float = 1.0, drivers: Drivers = MIXED) -> dict[str, t.Traffic]:
    def one(begin: tuple[str, int], end: tuple[str, int], rate: float) -> t.Flow:
        return flow(begin, end, rate * density, drivers)

    flows = [
        *(one(("west_in", lane), ("east_out", lane), 420) for lane in (0, 1)),
        *(one(("east_in", lane), ("west_out", lane), 420) for lane in (0, 1)),
        one(("west_in", 1), ("north_out", 0), 100),
        one(("east_in", 1), ("south_out", 0), 100),
        one(("north_in", 0), ("west_out", 0), 80),
        one(("south_in", 0), ("east_out", 0), 80),
        one(("north_in", 0), ("south_out", 0), 50),
        one(("south_in", 0), ("north_out", 0), 50),
    ]
    return traffic(flows, WARM_UP, FILLED)


missions = [
    t.Mission(t.Route(begin=("west_in", 1, 90), end=("north_out", 0, 50))),
    t.Mission(t.Route(begin=("east_in", 1, 80), end=("south_out", 0, 50))),
    t.Mission(t.Route(begin=("east_in", 0, 60), end=("west_out", 0, 70))),
]
from_the_side = [
    t.Mission(t.Route(begin=("south_in", 0, 80), end=("west_out", 1, 60))),
    t.Mission(t.Route(begin=("north_in", 0, 80), end=("east_out", 1, 60))),
    t.Mission(t.Route(begin=("west_in", 0, 80), end=("east_out", 0, 70))),
]

gen_scenario(
    t.Scenario(
        traffic=social(),
        ego_missions=missions,
        start_variation=START_IN_TOWN,
        held_out={
            "dense": t.Variation("More vehicles.", traffic=social(1.3)),
            "sparse_impatient": t.Variation("Fewer vehicles, all impatient.", traffic=social(0.6, IMPATIENT)),
            "from_the_side": t.Variation(
                "The egos turn left out of the side road.", ego_missions=from_the_side
            ),
            "signalised": t.Variation(
                "A signal without a phase for left turns.", map_spec=t.MapSpec(source="signalised")
            ),
        },
    ),
    output_dir=Path(__file__).parent,
)
