"""Frames of project files from `env.step` to a vehicle model's kernel.

    python perf/frames.py                 # every environment API, every vehicle model
    python perf/frames.py --frames        # their names, too

Each environment steps one agent on the scenario `loop`. The kernels of the vehicle models, and Bullet's own
step, are wrapped in a function that counts the frames of files in `smarts/` between the call of `env.step`
and the kernel. Compiled code and `bind` have no Python frames; the wrapper does not count.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from smarts.agents import ActionSpaceType, AgentInterface  # noqa: E402
from smarts.dynamics import MODELS  # noqa: E402
from smarts.env import (  # noqa: E402
    HiWayEnv,
    RLlibHiWayEnv,
    SingleHiWayEnv,
    SingleHiWayVectorEnv,
    VectorHiWayEnv,
    hiway_parallel_env,
)

NAME = "agent-0"
KERNELS = {
    "bullet": ("_advance_free",),
    "dynamic": ("_advance_dynamic",),
    "kinematic": ("_advance_kinematic",),
}
"""Bound kernels of `smarts.dynamics.Fleet`, by vehicle model."""


def environments(interface: AgentInterface) -> dict[str, tuple[Any, Callable[[Any], Any]]]:
    """Return for each environment API an environment with one agent, and a function that steps it."""
    agents = {NAME: interface}
    return {
        "HiWayEnv": (HiWayEnv(["loop"], agents), lambda env: env.step({NAME: 0})),
        "PettingZoo": (hiway_parallel_env(["loop"], agents), lambda env: env.step({NAME: 0})),
        "RLlib": (
            RLlibHiWayEnv({"scenarios": ["loop"], "agents": agents}),
            lambda env: env.step({NAME: 0}),
        ),
        "SingleHiWayEnv": (SingleHiWayEnv(["loop"], interface), lambda env: env.step(0)),
        "SingleHiWayVectorEnv": (
            SingleHiWayVectorEnv(1, ["loop"], interface),
            lambda env: env.step(np.zeros(1, int)),
        ),
        "VectorHiWayEnv": (
            VectorHiWayEnv(1, ["loop"], agents),
            lambda env: env.step([np.zeros((1, 1), int)]),
        ),
    }


def project_frames() -> list[str]:
    """Return the functions of project files on the stack below this file's, outermost first."""
    frame, found = sys._getframe(1), []
    while frame is not None:
        code = frame.f_code
        if Path(code.co_filename).is_relative_to(ROOT / "smarts"):
            found.append(f"{Path(code.co_filename).relative_to(ROOT)}:{code.co_qualname}")
        frame = frame.f_back
    return found[::-1]


@contextmanager
def recorded_frames(owner: Any, names: tuple[str, ...]) -> Iterator[dict[str, list[str]]]:
    """Record the frames of the first call of some functions of an object."""
    calls: dict[str, list[str]] = {}

    def watched(name: str, kernel: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            calls.setdefault(name, project_frames())
            return kernel(*arguments)

        return call

    kept = {name: getattr(owner, name) for name in names}
    for name, kernel in kept.items():
        setattr(owner, name, watched(name, kernel))
    try:
        yield calls
    finally:
        for name, kernel in kept.items():
            setattr(owner, name, kernel)


@contextmanager
def always_touching(fleet: Any) -> Iterator[None]:
    """Let Bullet move the vehicles even where none can touch another."""
    worlds = fleet._bullet

    def found(_: Any) -> bool:
        worlds._near[:] = True
        return True

    kept, worlds._find_near = worlds._find_near, found
    try:
        yield
    finally:
        worlds._find_near = kept


def runner_of(env: Any) -> Any:
    """Return the runner of an environment."""
    inner = getattr(env, "_env", env)
    return inner.runner if hasattr(inner, "runner") else inner._runner


def paths(model: Any) -> Iterator[tuple[str, str, list[str]]]:
    """Yield API, kernel and frames for one vehicle model."""
    from smarts.dynamics import bullet

    interface = AgentInterface(action=ActionSpaceType.Lane, vehicle_model=model)
    for api, (env, step) in environments(interface).items():
        try:
            env.reset(seed=1)
            fleet = runner_of(env).simulation._stages.vehicles.fleet
            with recorded_frames(fleet, KERNELS[model]) as calls:
                step(env)
            yield from ((api, name, frames) for name, frames in calls.items())
            if model == "bullet":
                with always_touching(fleet), recorded_frames(bullet.pybullet, ("stepSimulation",)) as calls:
                    step(env)
                yield from ((api, name, frames) for name, frames in calls.items())
        finally:
            env.close()


def main() -> None:
    """Print a table, and the largest count."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--frames", action="store_true", help="print the names of the frames")
    shows_names = parser.parse_args().frames
    most = 0
    for model in MODELS:
        for api, kernel, frames in paths(model):
            most = max(most, len(frames))
            print(f"{api:22}{model:12}{kernel:20}{len(frames):3}", flush=True)
            for frame in frames if shows_names else ():
                print(f"    {frame}")
    print(f"at most {most} frames")


if __name__ == "__main__":
    main()
