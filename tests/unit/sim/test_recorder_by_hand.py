"""What the recorder takes of hand-made frames: who is near, for how long, lights, voids, full buffers."""

from pathlib import Path

import numpy as np
import pyarrow.parquet as parquet

from smarts.errors import TrafficError
from smarts.roads.scene import Scene
from smarts.sim.episode_files import RecordedEpisode
from smarts.sim.recorder import EpisodeRecorder
from smarts.types.agent_states import AgentStatus
from smarts.types.episode import AgentStart, EpisodeStart
from smarts.types.events import Contacts, Events, Outcome
from smarts.types.frame import Frame, Readings
from smarts.types.mission import AgentMission
from smarts.types.traffic import Signal, TrafficFiles
from tests import maps
from tests.worlds import Car, world_of

EGO = AgentMission(route=("road",))


class Recording:
    """A hand-made world of one simulation, recorded."""

    def __init__(self, folder, cars, capacity=16, **options):
        self.made = world_of(cars, maps=[maps.straight(length=1000.0)], capacity=capacity)
        self.world = self.made.world
        scene = Scene(self.world, self.made.atlas, self.made.routes)
        self.recorder = EpisodeRecorder(scene, folder, self.made.pool, **options)
        self.folder = folder
        shape = self.world.agents.slot.shape
        self.contacts = Contacts.allocate(*shape, capacity)
        self.events = Events.allocate(*shape)
        agents = tuple(
            AgentStart(car.name, (car.x, car.y, 0.0), car.speed, car.mission) for car in cars if car.mission
        )
        self.start = EpisodeStart(7, 3, 5, "road", 0, TrafficFiles(Path("x")), None, 1, 10, agents)

    def frame(self, **more):
        rows = np.ones(1, np.bool_)
        wanted = np.zeros((1, 4), np.bool_)
        self.recorder.record(
            Frame(self.world, rows, None, None, self.contacts, self.events, wanted, Readings({}, {}), **more)
        )

    def begin(self):
        self.frame(starts={0: self.start})

    def step(self, times=1, **more):
        for _ in range(times):
            self.made.advance()
            self.frame(**more)

    def read(self):
        self.recorder.close()
        return RecordedEpisode(self.folder / "seed7_world3_episode00005")


def test_who_was_near_is_recorded_for_15_seconds_more(tmp_path):
    recording = Recording(tmp_path, [Car(100.0, 0.0, mission=EGO), Car(249.0, 0.0), Car(251.0, 0.0)])
    recording.begin()
    recording.step(10)
    recording.world.vehicles.position[0, 1] = 400.0, 0.0
    recording.step(200)
    vehicles = recording.read().table("vehicles")
    steps = {slot: vehicles["step"][vehicles["slot"] == slot].tolist() for slot in range(3)}
    assert steps[0] == list(range(211))
    assert steps[1] == list(range(10 + 150 + 1))
    assert steps[2] == []


def test_vehicles_far_from_agents_are_recorded_if_asked_for(tmp_path):
    cars = [
        Car(100.0, 0.0, mission=EGO),
        Car(200.0, 0.0, name="near"),
        Car(700.0, 3.2, speed=12.344, name="far"),
    ]
    recording = Recording(tmp_path, cars, everything=True)
    recording.begin()
    recording.step(10)
    recording.world.vehicles.position[0, 1] = 600.0, 0.0
    # More rows than a buffer holds.
    recording.step(2990)
    episode = recording.read()
    vehicles, names = episode.table("vehicles"), episode.table("names")
    for slot in range(3):
        assert vehicles["step"][vehicles["slot"] == slot].tolist() == list(range(3001))
    assert set(vehicles["x"][vehicles["slot"] == 2].tolist()) == {700.0}
    assert sorted(names["name"].tolist()) == ["car", "far", "near"]
    states = recording.world.vehicles
    for name in ("kind", "length", "width"):
        expected = [getattr(states, name)[0, slot] for slot in names["slot"]]
        np.testing.assert_allclose(names[name], expected, rtol=1e-6)


def test_more_than_the_buffers_hold(tmp_path):
    cars = [Car(100.0 + 8 * number, 0.0, mission=EGO if number < 4 else None) for number in range(16)]
    recording = Recording(tmp_path, cars)
    recording.begin()
    recording.step(1000)
    episode = recording.read()
    vehicles, agents = episode.table("vehicles"), episode.table("agent_states")
    # On disk a block is in order of vehicles, which takes fewer bytes.
    block = parquet.ParquetFile(episode.folder / "vehicles.parquet").read_row_group(0)
    assert (np.diff(block["slot"].to_numpy()) >= 0).all()
    assert len(set(block["step"].to_pylist())) > 1
    assert np.bincount(vehicles["step"]).tolist() == [16] * 1001
    assert (np.diff(vehicles["step"]) >= 0).all()
    assert vehicles["x"].reshape(1001, 16)[-1].tolist() == [100.0 + 8 * number for number in range(16)]
    assert agents["step"].tolist() == np.repeat(np.arange(1001), 4).tolist()


def test_lights_are_recorded_when_they_change(tmp_path):
    recording = Recording(tmp_path, [Car(100.0, 0.0, mission=EGO)])
    recording.world.signals[0, 1] = Signal.STOP
    recording.begin()
    recording.step(3)
    recording.world.signals[0, 1] = Signal.GO
    recording.step(3)
    signals = recording.read().table("signals")
    assert list(zip(*(signals[name].tolist() for name in ("step", "lane", "signal")), strict=True)) == [
        (0, 1, Signal.STOP),
        (4, 1, Signal.GO),
    ]


def void(recording):
    recording.world.agents.state[0, 0] = AgentStatus.DONE
    recording.world.agents.outcome[0, 0] = Outcome.INVALID
    recording.events.just_done[0, 0] = recording.events.truncated[0, 0] = recording.events.finished[0] = True


def test_an_overlap_at_the_start(tmp_path):
    recording = Recording(tmp_path, [Car(100.0, 0.0, mission=EGO)])
    void(recording)
    recording.begin()
    episode = recording.read()
    assert episode.facts["is_invalid"]
    assert episode.facts["is_complete"]
    assert "overlapped" in episode.facts["remark"]
    assert episode.table("agents")["outcome"].tolist() == [Outcome.INVALID]
    assert episode.table("agents")["truncated"].tolist() == [True]


def test_traffic_that_fails(tmp_path):
    recording = Recording(tmp_path, [Car(100.0, 0.0, mission=EGO)])
    recording.begin()
    void(recording)
    recording.step(failures={0: TrafficError("SUMO has gone")})
    facts = recording.read().facts
    assert facts["is_invalid"]
    assert facts["remark"] == "traffic failed: SUMO has gone"
