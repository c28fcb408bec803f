"""Controllers: actions of one type -> commands to vehicles, for all seats that act so in one call.

Control has two levels. Ten times a second a controller writes what a vehicle is to follow (`Commands`): a
reference, actuators, or poses. A hundred times a second one law (`tracking`) follows the reference, whoever
wrote it, in sight of the vehicle's motion.
"""

from smarts.registry import Registry

CONTROLLERS = Registry(
    "controller",
    {
        "Lane": "smarts.controllers.lane_actions:LaneActions",
        "LaneWithContinuousSpeed": "smarts.controllers.lane_following:LaneFollowing",
    },
)
"""`ActionSpaceType` name -> "module:Class" of a `smarts.controllers.protocol.Controller`; made with a `Scene`."""
