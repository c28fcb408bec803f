from pathlib import Path

from scenarios.drivers import MIXED, START_ON_A_ROAD, Drivers, impatient_car, traffic
from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

WARM_UP = 10.0
LAPS = 25
HALVES = ("east_half", "west_half")


def vehicles(count: int, drivers: Drivers = MIXED, lanes: int = 3) -> list[t.Trip]:
    """Return vehicles that set out at random places and keep circulating."""
    kinds = list(drivers)
    trips = []
    for i in range(count):
        first, second = HALVES if i % 2 else HALVES[::-1]
        route = t.Route(
            begin=(first, i % lanes, "random"),
            end=(second, i % lanes, "max"),
            via=(second, first) * (LAPS - 1),
        )
        actor = kinds[i // 2 % len(kinds)]
        trips.append(t.Trip(f"{actor.name}_{i}", route=route, actor=actor))
    return trips


def missions(lanes: int = 3) -> list[t.Mission]:
    """Most of a lap, ending one lane beside the start."""
    return [
        t.Mission(t.Route(begin=(first, lane % lanes, 30), end=(second, (lane + 1) % lanes, 200)))
        for first, second, lane in (
            ("east_half", "west_half", 0),
            ("east_half", "west_half", 1),
            ("west_half", "east_half", 2),
            ("west_half", "east_half", 1),
        )
    ]


gen_scenario(
    t.Scenario(
        traffic=traffic([], WARM_UP, trips=vehicles(26)),
        ego_missions=missions(),
        start_variation=START_ON_A_ROAD,
        held_out={
            "dense": t.Variation("More vehicles.", traffic=traffic([], WARM_UP, trips=vehicles(36))),
            "sparse_impatient": t.Variation(
                "Fewer vehicles, all impatient.",
                traffic=traffic([], WARM_UP, trips=vehicles(14, {impatient_car: 1})),
            ),
            "two_lanes": t.Variation(
                "Two lanes.",
                map_spec=t.MapSpec(source="two_lanes"),
                traffic=traffic([], WARM_UP, trips=vehicles(20, lanes=2)),
                ego_missions=missions(lanes=2),
            ),
        },
    ),
    output_dir=Path(__file__).parent,
)
