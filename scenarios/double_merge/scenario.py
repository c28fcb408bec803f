from pathlib import Path

from scenarios.drivers import IMPATIENT, MIXED, START_IN_TOWN, Drivers, flow, traffic
from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

WARM_UP = 25.0
FILLED = {"top_left_approach": 115, "down_left_approach": 115}


def social(density: float = 1.0, drivers: Drivers = MIXED, crossing: float = 0.6) -> dict[str, t.Traffic]:
    rates = {
        ("top_left", "down_right"): crossing,
        ("top_left", "top_right"): 1 - crossing,
        ("down_left", "top_right"): crossing,
        ("down_left", "down_right"): 1 - crossing,
    }
    flows = [
        flow((f"{begin}_approach", 0), (end, 0), 1000 * share * density, drivers)
        for (begin, end), share in rates.items()
    ]
    return traffic(flows, WARM_UP, FILLED)


# Vehicles from the left leave to the right, and the reverse.
missions = [
    t.Mission(t.Route(begin=(begin, 0, offset), end=(end, 0, 10)))
    for offset in (10, 25)
    for begin, end in (("top_left", "down_right"), ("down_left", "top_right"))
]

gen_scenario(
    t.Scenario(
        traffic=social(),
        ego_missions=missions,
        start_variation=START_IN_TOWN,
        held_out={
            "dense": t.Variation("More vehicles.", traffic=social(1.3)),
            "sparse_impatient": t.Variation("Fewer vehicles, all impatient.", traffic=social(0.6, IMPATIENT)),
            "all_cross": t.Variation("Every vehicle crosses.", traffic=social(crossing=1)),
            "three_lanes": t.Variation(
                "A third lane in the middle of the weaving section.",
                map_spec=t.MapSpec(source="three_lanes"),
            ),
        },
    ),
    output_dir=Path(__file__).parent,
)
