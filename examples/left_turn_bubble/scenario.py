"""An unprotected left turn in a bubble: agents drive the vehicles that turn left, traffic all others."""

from pathlib import Path

from scenarios.drivers import flow
from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

flows = [
    flow(("west_in", 1), ("north_out", 0), 200),
    flow(("west_in", 0), ("east_out", 0), 300),
    flow(("east_in", 0), ("west_out", 0), 300),
    flow(("east_in", 1), ("west_out", 1), 300),
]
# From 70 m before the junction, through it, and 30 m along the road on its left.
corners = [(-80, -8), (10, -8), (10, 42), (-6, 42), (-6, 8), (-80, 8)]
left_turn = t.Bubble(
    id="left-turn",
    zone=t.ConfigurableZone(corners),
    margin=10,
    collision_time=1.0,  # else those behind pile up
    actor=t.SocialAgentActor("turner", agent_locator="smarts.zoo:idm-v0"),
    # Vehicles are named after their drivers and flow: those of the first one turn left.
    exclusion_prefixes=[f"mixed-flow-{number}" for number in range(1, len(flows))],
)

gen_scenario(
    t.Scenario(traffic={"crossing": t.Traffic(flows=flows, warm_up=20.0)}, bubbles=[left_turn]),
    output_dir=Path(__file__).parent,
)
