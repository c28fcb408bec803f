from pathlib import Path

from scenarios.drivers import IMPATIENT, MIXED, START_IN_TOWN, Drivers, flow, traffic
from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

WARM_UP = 30.0
FILLED = {"north_approach": 95, "south_approach": 95, "west_approach": 95, "east_approach": 95}
OPPOSITE = {"north": "south", "south": "north", "west": "east", "east": "west"}
LEFT = {"north": "east", "south": "west", "west": "north", "east": "south"}
RIGHT = {"north": "west", "south": "east", "west": "south", "east": "north"}


def social(density: float = 1.0, drivers: Drivers = MIXED, lanes: int = 2) -> dict[str, t.Traffic]:
    arms = {"north": 680, "south": 680, "west": 680, "east": 680}
    leftmost = lanes - 1
    result = []
    for arm, rate in arms.items():
        per_arm = rate * density
        begin = f"{arm}_approach"
        for lane in range(lanes):
            result.append(
                flow((begin, lane), (f"{OPPOSITE[arm]}_exit", lane), 0.55 * per_arm / lanes, drivers)
            )
        result.append(flow((begin, leftmost), (f"{LEFT[arm]}_exit", leftmost), 0.12 * per_arm, drivers))
        result.append(flow((begin, 0), (f"{RIGHT[arm]}_exit", 0), 0.33 * per_arm, drivers))
    return traffic(result, WARM_UP, FILLED)


missions = [
    t.Mission(t.Route(begin=("south_in", 1, 40), end=("west_out", 0, 60))),
    t.Mission(t.Route(begin=("west_in", 1, 50), end=("east_out", 0, 60))),
    t.Mission(t.Route(begin=("north_in", 0, 40), end=("south_out", 1, 40))),
    t.Mission(t.Route(begin=("east_in", 0, 50), end=("west_out", 1, 40))),
]
mirrored = [
    t.Mission(t.Route(begin=("north_in", 1, 40), end=("east_out", 0, 60))),
    t.Mission(t.Route(begin=("east_in", 1, 50), end=("west_out", 0, 60))),
    t.Mission(t.Route(begin=("south_in", 0, 40), end=("north_out", 1, 40))),
    t.Mission(t.Route(begin=("west_in", 0, 50), end=("east_out", 1, 40))),
]
left_turns = [
    t.Mission(t.Route(begin=(f"{arm}_in", 1, 40), end=(f"{goal}_out", 1, 40))) for arm, goal in LEFT.items()
]
three_lanes = [
    t.Mission(t.Route(begin=("south_in", 2, 40), end=("west_out", 1, 60))),
    t.Mission(t.Route(begin=("west_in", 1, 50), end=("east_out", 0, 60))),
    t.Mission(t.Route(begin=("north_in", 0, 40), end=("south_out", 1, 40))),
    t.Mission(t.Route(begin=("east_in", 1, 50), end=("west_out", 2, 40))),
]

gen_scenario(
    t.Scenario(
        traffic=social(),
        ego_missions=missions,
        start_variation=START_IN_TOWN,
        held_out={
            "dense": t.Variation("More vehicles.", traffic=social(1.12)),
            "sparse_impatient": t.Variation("Fewer vehicles, all impatient.", traffic=social(0.6, IMPATIENT)),
            "mirrored": t.Variation("The missions, turned by 180 degrees.", ego_missions=mirrored),
            "left_turns": t.Variation(
                "Every ego turns left, among fewer vehicles.", traffic=social(0.65), ego_missions=left_turns
            ),
            "three_lanes": t.Variation(
                "Three lanes a direction.",
                map_spec=t.MapSpec(source="three_lanes"),
                traffic=social(lanes=3),
                ego_missions=three_lanes,
            ),
        },
    ),
    output_dir=Path(__file__).parent,
)
