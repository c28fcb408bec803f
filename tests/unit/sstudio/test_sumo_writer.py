"""SUMO's input: attribute by attribute, and as SUMO itself reads it."""

import subprocess
from collections import Counter
from pathlib import Path
from xml.etree import ElementTree

import pytest
import sumo

from smarts.sstudio import types as t
from smarts.sstudio.sumo_writer import sumo_traffic
from smarts.sstudio.vehicle_types import JUNCTIONS, LANE_CHANGING, SAMPLES
from smarts.types.streams import Purpose, stream

SUMO = Path(sumo.__file__).parent / "bin" / "sumo"
WEST_EAST = t.Route(("from_west", 0, 10), ("to_east", 0, "max"))
CAR = t.TrafficActor("car")


def written(roads, *flows, seed=0, net=Path("not read"), **more):
    traffic, generator = t.Traffic(flows=flows, **more), stream(seed, Purpose.BUILD)
    return sumo_traffic(traffic, roads, net, generator, "traffic", "scenario.py")


def elements(roads, *flows, **more):
    return ElementTree.fromstring(written(roads, *flows, **more).routes)


def flow(route=WEST_EAST, rate=600, **more):
    return t.Flow(route, rate, **({"actors": {CAR: 1}} | more))


def only(root, tag):
    (element,) = root.iter(tag)
    return element.attrib


class TestVehicleTypes:
    def test_a_default_car(self, roads):
        assert only(elements(roads, flow()), "vType") == {
            "id": CAR.id,
            "vClass": "passenger",
            "accel": "2.6",
            "decel": "4.5",
            "emergencyDecel": "4.5",
            "tau": "1",
            "sigma": "0.5",
            "minGap": "2.5",
            "maxSpeed": "55.5",
            "speedFactor": "normc(1,0.1,0.2,2)",
        }

    @pytest.mark.parametrize(
        ("speed", "factor", "deviation"),
        [
            (t.Distribution(0.8, 0.2), "normc(0.8,0.2,0.2,2)", None),
            (t.Distribution(0.1, 0.2), "normc(0.1,0.2,0.1,2)", None),
            (t.Distribution(0.8, 0), "0.8", "0"),
            (t.UniformDistribution(0.7, 0.7), "0.7", "0"),
        ],
    )
    def test_wanted_speeds(self, roads, speed, factor, deviation):
        attributes = only(elements(roads, flow(actors={t.TrafficActor("car", speed=speed): 1})), "vType")
        assert attributes["speedFactor"] == factor
        assert attributes.get("speedDev") == deviation

    @pytest.mark.parametrize(
        ("name", "attribute", "low", "high"),
        [
            ("min_gap", "minGap", 1, 4),
            ("imperfection", "sigma", 0.2, 0.6),
            ("speed", "speedFactor", 0.6, 0.9),
        ],
    )
    def test_what_sumo_cannot_draw_is_sampled(self, roads, name, attribute, low, high):
        actor = t.TrafficActor("car", **{name: t.UniformDistribution(low, high)})
        root = elements(roads, flow(actors={actor: 1}))
        values = [float(kind.attrib[attribute]) for kind in root.iter("vType")]
        assert len(values) == len(set(values)) == SAMPLES
        assert low <= min(values) < max(values) <= high
        mixture = only(root, "vTypeDistribution")
        assert mixture["vTypes"].split() == [kind.attrib["id"] for kind in root.iter("vType")]
        assert [float(share) for share in mixture["probabilities"].split()] == [1 / SAMPLES] * SAMPLES
        assert only(root, "flow")["type"] == mixture["id"]

    def test_weights_become_probabilities(self, roads):
        other = t.TrafficActor("car", tau=2)
        absent = t.TrafficActor("absent")
        root = elements(roads, flow(actors={CAR: 3, other: 1, absent: 0}))
        mixture = only(root, "vTypeDistribution")
        shares = dict(zip(mixture["vTypes"].split(), mixture["probabilities"].split(), strict=True))
        assert shares == {CAR.id: "0.75", other.id: "0.25"}


class TestFlows:
    def test_random_spacing_is_a_poisson_process(self, roads):
        attributes = only(elements(roads, flow(rate=1800, randomly_spaced=True)), "flow")
        assert attributes["period"] == "exp(0.5)"
        assert "vehsPerHour" not in attributes

    @pytest.mark.parametrize(
        ("offset", "departs", "arrives"),
        [(7.5, "7.5", "7.5"), ("base", "base", "0"), ("random", "random", "random"), ("max", None, "max")],
    )
    def test_offsets(self, roads, offset, departs, arrives):
        root = elements(roads, flow(t.Route(("from_west", 1, offset), ("to_east", 0, offset))))
        attributes = only(root, "flow")
        length = f"{roads.sumo_length[roads.lane_number('from_west', 1)]:.10g}"
        assert attributes["departPos"] == (departs or length)
        assert attributes["arrivalPos"] == arrives
        assert (attributes["departLane"], attributes["arrivalLane"]) == ("1", "0")

    def test_departures_at_the_end_count_as_sumo_does(self, long_roads):
        """The lane is drawn 100 m long and is given 200 m: SUMO drives what is drawn."""
        described = flow(t.Route(("one", 0, "max"), ("two", 0, 75)))
        (element,) = elements(long_roads, described).iter("flow")
        assert float(element.attrib["departPos"]) == pytest.approx(100)

    def test_drivers_that_depart_differently_are_flows_of_their_own(self, roads):
        slow = t.TrafficActor("car", depart_speed=3)
        root = elements(roads, flow(rate=400, actors={CAR: 3, slow: 1}))
        flows = {element.attrib["departSpeed"]: element.attrib for element in root.iter("flow")}
        assert flows["max"]["vehsPerHour"] == "300"
        assert flows["3"]["vehsPerHour"] == "100"
        assert flows["3"]["type"] == slow.id

    def test_random_routes_depend_on_the_seed_alone(self, roads):
        same = t.RandomRoute("same")
        flows = [flow(same), flow(same), *(flow(t.RandomRoute(f"{number}")) for number in range(6))]
        first, again, other = (written(roads, *flows, seed=seed) for seed in (1, 1, 2))
        assert first == again
        assert first != other
        routes = [element.attrib["route"] for element in ElementTree.fromstring(first.routes).iter("flow")]
        assert routes[0] == routes[1]
        assert len(set(routes)) > 2

    def test_vehicles_that_cannot_come_back_are_noted(self, roads):
        result = written(roads, flow(repeat_route=True))
        assert result.notes == (
            "traffic.flows[0]: no way leads back to 'from_west', so vehicles leave at the end of the route",
        )


def run_sumo(net, folder, traffic, seconds, *options):
    """Run SUMO on the files and return what it says, having failed on any error or warning."""
    (folder / "x.rou.xml").write_text(traffic.routes)
    command = [SUMO, "--net-file", net, "--route-files", folder / "x.rou.xml", "--end", seconds, *options]
    if traffic.additional:
        (folder / "x.add.xml").write_text(traffic.additional)
        command += ["--additional-files", folder / "x.add.xml"]
    command += ["--xml-validation", "never", "--xml-validation.routes", "never", "--no-step-log"]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
    complaints = [line for line in done.stderr.splitlines() if line and "SUMO_HOME" not in line]
    assert not complaints
    assert done.returncode == 0


class TestWithSumo:
    def test_every_attribute_is_known(self, roads, cross_net, tmp_path):
        actor = t.TrafficActor(
            "car",
            lane_changing_model=t.LaneChangingModel(**{name.removeprefix("lc"): 1 for name in LANE_CHANGING}),
            junction_model=t.JunctionModel(**{name.removeprefix("jm"): 1 for name in JUNCTIONS}),
            imperfection=t.Distribution(0.5, 0.2),
        )
        run_sumo(cross_net, tmp_path, written(roads, flow(actors={actor: 1})), 30)

    def test_shares_and_rates_hold(self, roads, cross_net, tmp_path):
        bus = t.TrafficActor("bus", vehicle_type="bus")
        traffic = written(roads, flow(rate=900, end=600, actors={CAR: 0.7, bus: 0.3}), net=cross_net)
        out = tmp_path / "routes.xml"
        run_sumo(cross_net, tmp_path, traffic, 600, "--vehroute-output", out, "--seed", 3)
        kinds = Counter(v.attrib["type"].split("-")[0] for v in ElementTree.parse(out).iter("vehicle"))
        assert kinds.total() == pytest.approx(150, abs=15)  # those of the last seconds are still on the road
        assert kinds["bus"] / kinds.total() == pytest.approx(0.3, abs=0.1)

    @pytest.mark.parametrize("end", [("south", 0, 5), ("east", 0, 20)])
    def test_repeated_routes_go_round_until_the_end(self, ring, ring_net, tmp_path, end):
        repeated = flow(t.Route(("south", 0, 10), end), rate=1, end=10, repeat_route=True)
        traffic, out = written(ring, repeated), tmp_path / "summary.xml"
        run_sumo(ring_net, tmp_path, traffic, 600, "--summary-output", out)
        assert {step.attrib["running"] for step in ElementTree.parse(out).iter("step")} == {"1"}
        (edges,) = (
            route.attrib["edges"].split() for route in ElementTree.fromstring(traffic.routes).iter("route")
        )
        assert edges == ["south", "east", "north", "west"]

    def test_buses_halt(self, roads, cross_net, tmp_path):
        bus = t.TrafficActor("bus", vehicle_type="bus")
        trip = t.Trip("bus", WEST_EAST, "bus", actor=bus, stops=[t.Stop("to_east", 0, 60, duration=12)])
        out = tmp_path / "stops.xml"
        run_sumo(cross_net, tmp_path, written(roads, trips=[trip], net=cross_net), 120, "--stop-output", out)
        (halt,) = ElementTree.parse(out).iter("stopinfo")
        assert float(halt.attrib["pos"]) == pytest.approx(60, abs=1)
        assert float(halt.attrib["ended"]) - float(halt.attrib["started"]) == pytest.approx(12, abs=1.5)
