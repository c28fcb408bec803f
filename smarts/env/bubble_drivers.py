"""Whether agents can drive the vehicles that bubbles hand over to them: checked before the first step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from smarts.agents.interface import AgentInterface
from smarts.agents.options import InterfaceError
from smarts.agents.social import BubbleLearning, SocialPolicy, Wanted, interface_of
from smarts.bubbles.placing import agent_actor
from smarts.sim.social_starts import wanted_by
from smarts.sstudio import sstypes as t
from smarts.sstudio.built import BuiltScenario
from smarts.sstudio.sstypes.condition import demanded
from smarts.types.actions import ActionSpaceType
from smarts.types.vehicles import VehicleKind


def check_action(interface: AgentInterface, place: str) -> None:
    """Raise `InterfaceError` unless an agent acts; names `place`."""
    if interface.action in (None, ActionSpaceType.Empty):
        raise InterfaceError(
            f"the interface's action is {interface.action!r}: the agent cannot drive",
            place=place,
            remedy="give AgentInterface(action=...) an action type such as ActionSpaceType.Lane",
        )


def check_drivers(
    built: BuiltScenario,
    policies: Sequence[SocialPolicy],
    numbers: Mapping[Wanted, int],
    learning: BubbleLearning | None,
    learner: AgentInterface | None,
) -> None:
    """Raise unless the agents of a scenario's bubbles can drive the vehicles that come.

    Args:
        built: The scenario.
        policies: Of the run.
        numbers: Number of each policy that was asked for.
        learning: In which bubbles the learning agents drive.
        learner: Their interface; None: not known, and not checked.

    Raises:
        InterfaceError: An agent does not act, or drives vehicles of another kind; names the bubble.
    """
    for bubble in built.scenario.bubbles or ():
        actor = agent_actor(bubble)
        if actor is None:
            continue
        place = f"{built.name}: bubble {bubble.id!r}"
        if learning and learning.has(bubble.id):
            if learner is not None:
                _check(bubble, learner, f"{place}, learning agents")
        else:
            policy = policies[numbers[wanted_by(actor)]]
            _check(bubble, interface_of(policy.spec), f"{place}, actor {actor.name!r}")


def _check(bubble: t.Bubble, interface: AgentInterface, place: str) -> None:
    check_action(interface, place)
    kind = interface.vehicle_kind
    if kind == VehicleKind.PASSENGER:
        return
    # A vehicle stays what it is: the class that an interface asks for has to come by itself.
    name = kind.name.lower()
    conditions = demanded(bubble.airlock_condition)
    if not any(isinstance(each, t.VehicleTypeCondition) and each.vehicle_type == name for each in conditions):
        raise InterfaceError(
            f"vehicle_class is {interface.vehicle_class!r}, and the bubble takes the vehicles that come",
            place=place,
            remedy=f"leave it out, or give the bubble airlock_condition=VehicleTypeCondition({name!r})",
        )
