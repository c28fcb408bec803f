from pathlib import Path

from scenarios.drivers import IMPATIENT, MIXED, START_IN_TOWN, Drivers, flow, traffic
from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

WARM_UP = 30.0
FILLED = {"street_in": 200}
bus = t.TrafficActor(
    name="bus", vehicle_type="bus", accel=1.2, decel=3.0, speed=t.Distribution(mean=0.9, sigma=0.05)
)
bay = t.Stop(road_id="stop_section", lane_index=0, offset=90, duration=12, length=45, bus_stop=True)


def social(density: float = 1.0, drivers: Drivers = MIXED, lanes: int = 2) -> dict[str, t.Traffic]:
    buses = flow(("street_in", 0), ("street_out", 0), 200, {bus: 1}, stops=(bay,))
    cars = [flow(("street_in", lane), ("street_out", lane), 1000 * density, drivers) for lane in range(lanes)]
    flows = [buses, *cars]
    return traffic(flows, WARM_UP, FILLED)


missions = [
    t.Mission(t.Route(begin=("stop_section", 0, 25), end=("street_out", 0, 80))),
    t.Mission(t.Route(begin=("street_in", 0, 150), end=("street_out", 0, 110))),
    t.Mission(t.Route(begin=("street_in", 1, 120), end=("street_out", 1, 110))),
]
from_the_left = [
    t.Mission(t.Route(begin=("street_in", 1, 150), end=("street_out", 0, 60))),
    t.Mission(t.Route(begin=("street_in", 0, 120), end=("street_out", 1, 90))),
]
one_lane = [
    t.Mission(t.Route(begin=("stop_section", 0, 25), end=("street_out", 0, 80))),
    t.Mission(t.Route(begin=("street_in", 0, 150), end=("street_out", 0, 110))),
]

gen_scenario(
    t.Scenario(
        traffic=social(),
        ego_missions=missions,
        start_variation=START_IN_TOWN,
        held_out={
            "dense": t.Variation("More vehicles.", traffic=social(1.3)),
            "sparse_impatient": t.Variation("Fewer vehicles, all impatient.", traffic=social(0.6, IMPATIENT)),
            "from_the_left": t.Variation(
                "The egos pass the stop and change lanes.", ego_missions=from_the_left
            ),
            "one_lane": t.Variation(
                "One lane beside the bay.",
                map_spec=t.MapSpec(source="one_lane"),
                traffic=social(lanes=1),
                ego_missions=one_lane,
            ),
        },
    ),
    output_dir=Path(__file__).parent,
)
