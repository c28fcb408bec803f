"""Pictures of running simulations: what is drawn lies where the vehicles are."""

import matplotlib.colors
import numpy as np
import pytest

from smarts.agents.benchmark import benchmark_interface
from smarts.env import HiWayEnv, SingleHiWayEnv, hiway_parallel_env
from smarts.env.black_death import BlackDeath
from smarts.envision.scenario_picture import CAR, EGOS
from smarts.envision.world_picture import HEIGHT, WIDTH


def pixels(image, colour):
    """Return x and y of the pixels of a colour, from the lower left corner."""
    rgb = np.round(np.array(matplotlib.colors.to_rgb(colour)) * 255)
    rows, columns = np.nonzero(np.abs(image.astype(int) - rgb).max(-1) <= 3)
    return np.stack([columns, HEIGHT - rows], -1)


@pytest.fixture(scope="module")
def parallel():
    env = hiway_parallel_env(["intersection"], 4, seed=1, render_mode="rgb_array")
    yield env
    env.close()


def test_vehicles_are_drawn_where_they_are(parallel):
    parallel.reset(seed=1)
    for _ in range(4):
        parallel.step(dict.fromkeys(parallel.agents, 0))
    image = parallel.render()
    assert image.shape == (HEIGHT, WIDTH, 3)
    assert image.dtype == np.uint8
    world, axes = parallel._env.runner.world, parallel._env.renderer._picture._view.axes
    for agent_id, slot in enumerate(world.agents.slot[0, :4].tolist()):
        expected = axes.transData.transform(world.vehicles.position[0, slot])
        # The numbers beside vehicles and the rings at goals have the colour, too.
        off = np.abs(pixels(image, EGOS[agent_id]) - expected).max(-1)
        assert off.min() < 6
    traffic = np.setdiff1d(np.flatnonzero(world.vehicles.alive[0]), world.agents.slot[0])
    inside = [slot for slot in traffic.tolist() if _is_inside(axes, world.vehicles.position[0, slot])]
    for slot in inside:
        expected = axes.transData.transform(world.vehicles.position[0, slot])
        assert np.abs(pixels(image, CAR) - expected).max(-1).min() < 6


def _is_inside(axes, position):
    x, y = axes.transData.transform(position)
    return 20 < x < WIDTH - 20 and 20 < y < HEIGHT - 60


def test_pictures_change_with_the_simulation_and_not_with_the_drawing(parallel):
    parallel.reset(seed=1)
    first = parallel.render()
    np.testing.assert_array_equal(first, parallel.render())
    parallel.step(dict.fromkeys(parallel.agents, 0))
    assert (first != parallel.render()).any()
    parallel.reset(seed=1)
    np.testing.assert_array_equal(first, parallel.render())
    assert parallel.metadata["render_fps"] == 2


def test_the_original_environment_and_black_death_draw():
    env = HiWayEnv(["loop"], {"a": benchmark_interface()}, render_mode="rgb_array")
    env.reset(seed=1)
    assert env.render().shape == (HEIGHT, WIDTH, 3)
    env.close()
    padded = BlackDeath(hiway_parallel_env(["loop"], 1, render_mode="rgb_array"))
    padded.reset(seed=1)
    assert padded.render().shape == (HEIGHT, WIDTH, 3)
    padded.close()


def test_without_a_mode_nothing_is_drawn():
    env = SingleHiWayEnv(["loop"])
    env.reset(seed=1)
    with pytest.warns(UserWarning, match="render_mode"):
        assert env.render() is None
    env.close()
