from pathlib import Path

from scenarios.drivers import ALL_KINDS, KINDS, START_IN_TOWN, Drivers, flow, placed, slowly, traffic
from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

WARM_UP = 10.0
SLOW = 6.0
"""Speed of a normal slow vehicle [m/s]."""
WAYS = ("eastbound", "westbound")


def social(density: float = 1.0, drivers: Drivers = ALL_KINDS, lanes: int = 1) -> dict[str, t.Traffic]:
    """Return a slow leader 15 m ahead of each front agent, a slow vehicle behind it, and others."""
    flows = []
    moment = WARM_UP - 0.2
    for way in WAYS:
        for lane in range(lanes):
            goal = f"{way}_exit", lane
            slow = [(way, lane, 26), (f"{way}_approach", lane, 102.5)]
            others = [
                (way, lane, 50),
                (way, lane, 75),
                (f"{way}_approach", lane, 55),
                (f"{way}_approach", lane, 30),
            ]
            flows += placed(slow, goal, moment, slowly(drivers, SLOW))
            flows += placed(others, goal, moment, drivers)
            flows.append(flow((f"{way}_approach", lane), goal, 700 * density, drivers, begin=moment))
    return traffic(flows, WARM_UP)


def missions() -> list[t.Mission]:
    """Return two missions a direction, 45 m apart, each of 202 m: below 3.4 m/s that takes a minute."""
    return [
        t.Mission(t.Route(begin=begin, end=(f"{way}_exit", 0, goal)))
        for goal, ahead in ((65, False), (110, True))
        for way in ("westbound", "eastbound")
        for begin in [(way, 0, 5) if ahead else (f"{way}_approach", 0, 80)]
    ]


gen_scenario(
    t.Scenario(
        map_spec=t.MapSpec(source="../two_way"),
        traffic=social(),
        ego_missions=missions(),
        start_variation=START_IN_TOWN,
        held_out={
            **{
                kind: t.Variation(f"All drivers {kind}.", traffic=social(drivers=drivers))
                for kind, drivers in KINDS.items()
            },
            "dense": t.Variation("More vehicles.", traffic=social(1.5)),
            "two_lanes": t.Variation(
                "Two lanes a direction.",
                map_spec=t.MapSpec(source="../two_way/two_lanes"),
                traffic=social(lanes=2),
            ),
        },
    ),
    output_dir=Path(__file__).parent,
)
