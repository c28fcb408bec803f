"""A crossing in a bubble: agents of the zoo drive the vehicles of traffic across it, and give them back."""

from pathlib import Path

from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

ACTORS = {
    t.TrafficActor("car"): 0.8,
    t.TrafficActor("bus", vehicle_type="bus"): 0.1,
    t.TrafficActor("truck", vehicle_type="truck"): 0.1,
}
WAYS = [("west", 0, "east", 0), ("west", 1, "east", 1), ("east", 0, "west", 0), ("east", 1, "west", 1)]
WAYS += [("north", 0, "south", 0), ("south", 0, "north", 0), ("south", 0, "east", 0)]

flows = [
    t.Flow(
        route=t.Route(begin=(f"{begin}_in", lane, 5), end=(f"{end}_out", to, "max")), rate=250, actors=ACTORS
    )
    for begin, lane, end, to in WAYS
]
crossing = t.Bubble(
    id="crossing",
    zone=t.PositionalZone(pos=(0, 0), size=(140, 100)),
    margin=20,
    actor=t.SocialAgentActor("driver", agent_locator="smarts.zoo:idm-v0"),
)

gen_scenario(
    t.Scenario(
        traffic={"busy": t.Traffic(flows=flows, warm_up=40)},
        ego_missions=[t.Mission(t.Route(begin=("west_in", 0, 30), end=("east_out", 0, "max")))],
        bubbles=[crossing],
    ),
    output_dir=Path(__file__).parent,
)
