"""Pictures of bubbles and of vehicles by their drivers, by the colours at known places."""

import dataclasses

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, PathPatch
from shapely import Polygon, box

from smarts.envision.bubble_shapes import rings_of
from smarts.envision.episode_picture import EpisodePicture
from smarts.envision.scenario_picture import ASPHALT, CAR, EGOS, draw_bubbles
from smarts.envision.vehicle_shapes import HATCH, SOCIAL, STRIPES
from smarts.sim.moments import Moment
from smarts.sstudio import types as t
from smarts.types.agent_states import AgentStatus
from smarts.types.bubbles import BubbleStates, PlacedBubble
from smarts.types.transfers import Reason
from smarts.types.vehicles import VehicleStates
from tests import maps
from tests.unit.envision.test_episode_picture import colour_at, is_colour
from tests.unit.sim.test_recorder_handovers import AGENT, COLUMN, TRAFFIC, Handovers

LENGTH = 5.0
STAYS, TRAVELS = 0, 1


def rectangle(low_x, low_y, high_x, high_y):
    return rings_of(box(low_x, low_y, high_x, high_y))[0]


@pytest.fixture(scope="module")
def episode(tmp_path_factory):
    """Return a vehicle at x = 120 m that is observed, driven, and to be released, a second each."""
    recording = Handovers(tmp_path_factory.mktemp("bubbles"))
    zone, margin = rectangle(110.0, -8.0, 130.0, 8.0), rectangle(105.0, -13.0, 135.0, 13.0)
    small, around = rectangle(-4.0, -2.0, 4.0, 2.0), rectangle(-6.0, -4.0, 6.0, 4.0)
    bubbles = (
        PlacedBubble("stays", "actor", 1, 0, (zone,), (margin,)),
        PlacedBubble("travels", "actor", 1, 0, (small,), (around,), followed="second"),
    )
    recording.start = dataclasses.replace(recording.start, bubbles=bubbles)
    states = BubbleStates.allocate(1, 2)
    states.is_active[:] = True
    states.pose[0, TRAVELS] = 150.0, 12.0, 0.0
    recording.frame(starts={0: recording.start}, bubbles=states)
    agents, vehicles = recording.world.agents, recording.world.vehicles
    number = recording.announce("social", 1)
    recording.hold(number, 1, AgentStatus.SHADOWING)
    shadow = recording.transfer(1, (TRAFFIC, TRAFFIC), (-1, -1), Reason.SHADOW, number=number)
    recording.step(transfers=[shadow], bubbles=states)
    agents.state[0, COLUMN], vehicles.owner[0, 1] = AgentStatus.ACTIVE, AGENT
    states.pose[0, TRAVELS] = 160.0, 12.0, np.pi / 2
    recording.step(bubbles=states)
    agents.release_step[0, COLUMN] = 3
    states.is_active[0, STAYS] = False
    recording.step(bubbles=states)
    agents.state[0, COLUMN] = AgentStatus.LEAVING
    recording.step(bubbles=states)
    return recording.read()


@pytest.fixture(scope="module")
def picture(episode):
    return EpisodePicture(episode, pixels=1600)


def test_vehicles_have_the_colours_of_their_drivers(picture):
    for step, body, stripe in ((0, CAR, CAR), (1, CAR, SOCIAL), (2, SOCIAL, SOCIAL)):
        image = picture.image(step)
        # Between stripes and nose, and on a stripe.
        assert is_colour(colour_at(picture, image, 120.0 + 0.12 * LENGTH, 0.0), body), step
        assert is_colour(colour_at(picture, image, 120.0 + STRIPES[1] * LENGTH, 0.3), stripe), step
        assert is_colour(colour_at(picture, image, 99.5, -0.3), EGOS[0])
        assert is_colour(colour_at(picture, image, 140.5, 0.3), CAR)


def test_vehicles_that_leave_are_hatched_whoever_drives(picture):
    for step in (3, 4):
        image = picture.image(step)
        assert is_colour(colour_at(picture, image, 120.0 + 0.12 * LENGTH, 0.0), SOCIAL)
        rear = [colour_at(picture, image, 120.0 + x, 0.0) for x in np.arange(-2.4, 0.0, 0.05)]
        assert any(is_colour(found, HATCH) for found in rear)


def test_zones_are_shaded_where_the_bubble_is_while_it_is_active(picture):
    image = picture.image(0)
    plain = colour_at(picture, image, 102.5, 4.0)
    assert is_colour(plain, ASPHALT)
    assert not is_colour(colour_at(picture, image, 112.5, 4.0), ASPHALT)
    assert is_colour(colour_at(picture, picture.image(3), 112.5, 4.0), ASPHALT)
    # The second turns by a quarter: the point is in its length only before.
    for step, x, is_shaded in ((1, 153.5, True), (2, 153.5, False), (2, 160.0, True), (1, 160.0, False)):
        found = colour_at(picture, picture.image(step), x, 13.2)
        assert (found < 250).any() == is_shaded, (step, x)


def test_the_window_has_all_bubbles_in_all_poses(picture):
    low, high = picture._window()
    assert (low <= (94.0, -13.0)).all()
    assert (high >= (166.0, 18.0)).all()


def drawn(bubble, moment):
    """Return the outlines of zone and margin in a picture of a scenario, and the texts."""
    axes = Figure().add_subplot()
    draw_bubbles(axes, maps.straight(), [bubble], moment)
    outlines = [patch.get_path().vertices for patch in axes.patches if isinstance(patch, PathPatch)]
    zone, margin = (Polygon(np.asarray(outline)) for outline in outlines)
    arrows = [patch for patch in axes.patches if isinstance(patch, FancyArrowPatch)]
    assert [text.get_text() for text in axes.texts] == [bubble.id]
    return zone, margin, arrows


def bubble_at(x, y, **more):
    actor = t.SocialAgentActor("driver", "smarts.zoo:idm-v0")
    zone = t.PositionalZone(pos=(x, y), size=(20, 10))
    return t.Bubble(id="one", zone=zone, margin=3, actor=actor, **more)


def test_a_bubble_that_travels_is_drawn_ahead_of_the_vehicle_that_it_follows():
    """By 7 m, and turned by its heading from north; without the vehicle as in the file."""
    states = VehicleStates._make(column[0] for column in VehicleStates.allocate(1, 4))
    states.position[2], states.heading[2] = (100.0, 3.0), 0.0
    bubble = bubble_at(50.0, 0.0, follow_vehicle_id="bus", follow_offset=(0, 7))
    zone, _, arrows = drawn(bubble, Moment(states, names={"bus": 2}))
    assert zone.bounds == pytest.approx((102.0, -7.0, 112.0, 13.0))
    assert len(arrows) == 1
    zone, _, arrows = drawn(bubble, Moment(states))
    assert zone.bounds == (40.0, -5.0, 60.0, 5.0)
    assert len(arrows) == 1
