"""An unprotected left turn in a bubble: agents drive the vehicles that turn left, traffic all others."""

from pathlib import Path

from scenarios.drivers import flow
from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

flows = [
    flow(("west_in", 1), ("north_out", 0), 240),
    flow(("east_in", 1), ("west_out", 1), 700),
    flow(("east_in", 0), ("west_out", 0), 250),
]
# From 75 m before the junction, in which any car can stop, through it, and 20 m along the road on its left.
corners = [(-85, -8), (10, -8), (10, 30), (-6, 30), (-6, 8), (-85, 8)]
left_turn = t.Bubble(
    id="left-turn",
    zone=t.ConfigurableZone(corners),
    margin=10,
    limit=t.BubbleLimits(1, 1),  # one at a time, so that a crash is with oncoming traffic
    collision_time=1.0,  # else those behind pile up
    actor=t.SocialAgentActor("turner", agent_locator="smarts.zoo:idm-v0"),
    # Vehicles are named after their drivers and flow: those of the first one turn left.
    exclusion_prefixes=[f"mixed-flow-{number}" for number in range(1, len(flows))],
)

gen_scenario(
    t.Scenario(traffic={"crossing": t.Traffic(flows=flows, warm_up=20.0)}, bubbles=[left_turn]),
    output_dir=Path(__file__).parent,
)
