"""Bodies that touch nothing, moved by our kernel, against Bullet."""

import numpy as np
import pytest

from smarts.dynamics import Box, Fleet, layout
from smarts.dynamics.bullet import BulletWorld
from smarts.dynamics.free_motion import integrate

FAR = {1: Box((9000.0, 0.0, 1.0), 0.0, 0.0, 4.0, 2.0, 2.0)}
"""With any box, all of a simulation is Bullet's."""


def same_motion(bodies, others):
    """How far two sets of bodies are apart; a quaternion and its negative are the same rotation."""
    signs = np.sign((bodies[:, 3:7] * others[:, 3:7]).sum(-1, keepdims=True))
    turned = np.concatenate([bodies[:, :3], signs * bodies[:, 3:7], bodies[:, 7:]], -1)
    return np.abs(turned - others).max()


@pytest.mark.parametrize(("name", "spin"), [("passenger", 0.0), ("bus", 3.0), ("motorcycle", 90.0)])
def test_a_tumbling_body_moves_as_in_bullet(name, spin):
    rng = np.random.default_rng(7)
    car = layout.pack(name, "pacejka")
    ours = np.zeros((1, layout.BODY_SIZE))
    ours[0] = *rng.normal(0, 9, 3), *rng.normal(0, 1, 4), *rng.normal(0, 20, 3), *rng.normal(0, 1, 3)
    ours[0, 3:7] /= np.linalg.norm(ours[0, 3:7])
    ours[0, 10:13] *= spin / np.linalg.norm(ours[0, 10:13])
    bullets = ours.copy()
    world = BulletWorld(bullets, 0.01)
    world.add(0, car)
    for _ in range(100):
        push = rng.normal(0, 0.05, (2, 3))
        world.substep([(bullets[0, 7:].reshape(2, 3) + push).tolist()])
        integrate(car, ours[0], ours[0, 7:].reshape(2, 3) + push, 0.01)
        assert same_motion(ours, bullets) < 1e-9 * max(1.0, spin)
    world.close()


@pytest.mark.parametrize(
    ("heading", "speed", "place"),
    [
        (np.pi, 12.0, (25.0, 0.6)),  # head on, not quite in line
        (np.pi / 2, 9.0, (15.0, -9.0)),  # from the side
        (0.0, 3.0, (9.0, 0.3)),  # from behind
        (np.pi, 14.0, (30.0, 1.75)),  # past each other, 14 cm apart
    ],
)
def test_whoever_meets_meets_in_bullet(heading, speed, place):
    """The same collision with and without having been out of Bullet before."""
    with Fleet(1, 2) as ours, Fleet(1, 2) as bullets:
        for fleet in (ours, bullets):
            fleet.spawn(0, "passenger", (0.0, 0.0), 0.0, 14.0)
            fleet.spawn(1, "passenger", place, heading, speed)
        bullets.place_boxes(0, FAR)
        for _ in range(25):
            for fleet in (ours, bullets):
                fleet.step(np.zeros((2, 3)))
            apart = ours.motion.substeps - bullets.motion.substeps
            apart[..., 2] = np.sin(apart[..., 2])  # pi is -pi
            assert np.abs(apart).max() < 1e-6
        slowed = np.hypot(*ours.motion.velocity[:2].T) < np.array([14.0, speed]) - 1.0
        assert slowed.any() == (place[1] != 1.75)


def test_a_simulation_is_bullets_only_while_somebody_is_near():
    with Fleet(2, 2) as fleet:
        for row, x in enumerate((0.0, 30.0, 0.0, 300.0)):
            fleet.spawn(row, "passenger", (x, 0.0), 0.0, 15.0 if row % 2 == 0 else 0.0)
        asked = [[], []]
        for world, calls in zip(fleet._bullet._worlds.values(), asked, strict=True):
            world.substep = lambda velocities, calls=calls, go=world.substep: (
                calls.append(1),
                go(velocities),
            )
        counts = []
        for _ in range(20):
            for calls in asked:
                calls.clear()
            fleet.step(np.zeros((4, 3)))
            counts.append([len(calls) for calls in asked])
        counts = np.array(counts)
        assert counts[:12, 0].max() == 0
        assert counts[:, 0].max() == 10
        assert counts[:, 1].max() == 0
        assert fleet.motion.velocity[1, 0] > 3.0  # it was hit
