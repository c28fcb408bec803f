from pathlib import Path

from scenarios.drivers import IMPATIENT, MIXED, START_IN_TOWN, Drivers, flow, traffic
from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

WARM_UP = 20.0
FILLED = {"north_in": 95, "south_in": 95, "west_in": 95, "east_in": 95}
ARMS = ("east", "north", "west", "south")
"""In the order in which the ring passes them."""


def social(density: float = 1.0, drivers: Drivers = MIXED, lanes: int = 1) -> dict[str, t.Traffic]:
    flows = [
        flow((f"{arm}_in", lane), (f"{ARMS[(i + turn) % 4]}_out", lane), rate * density / lanes, drivers)
        for i, arm in enumerate(ARMS)
        for turn, rate in ((1, 110), (2, 190), (3, 100))
        for lane in range(lanes)
    ]
    return traffic(flows, WARM_UP, FILLED)


def missions(*exits: int) -> list[t.Mission]:
    """One ego an arm; each leaves by the first, second or third exit that it meets."""
    return [
        t.Mission(t.Route(begin=(f"{arm}_in", 0, 70), end=(f"{ARMS[(i + turn) % 4]}_out", 0, 40)))
        for i, (arm, turn) in enumerate(zip(ARMS, exits, strict=True))
    ]


gen_scenario(
    t.Scenario(
        traffic=social(),
        ego_missions=missions(2, 3, 2, 1),
        start_variation=START_IN_TOWN,
        held_out={
            "dense": t.Variation("More vehicles.", traffic=social(1.25)),
            "sparse_impatient": t.Variation("Fewer vehicles, all impatient.", traffic=social(0.6, IMPATIENT)),
            "third_exits": t.Variation("Every ego takes its third exit.", ego_missions=missions(3, 3, 3, 3)),
            "two_lanes": t.Variation(
                "Two lanes in the ring and on the arms.",
                map_spec=t.MapSpec(source="two_lanes"),
                traffic=social(1.4, lanes=2),
            ),
        },
    ),
    output_dir=Path(__file__).parent,
)
