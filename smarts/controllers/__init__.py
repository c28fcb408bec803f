"""Controllers: actions of one type -> commands to vehicles, for all agents that act so in one call.

Control has two levels. Ten times a second a controller writes what a vehicle is to follow (`Commands`): a
reference, actuators, or poses. A hundred times a second one law (`tracking`) follows the reference, whoever
wrote it, in sight of the vehicle's motion.
"""

from smarts.registry import Registry

CONTROLLERS = Registry(
    "controller",
    {
        "Continuous": "smarts.controllers.continuous:Continuous",
        "Lane": "smarts.controllers.lane_actions:LaneActions",
        "ActuatorDynamic": "smarts.controllers.actuator_dynamic:ActuatorDynamic",
        "LaneWithContinuousSpeed": "smarts.controllers.lane_following:LaneFollowing",
        "TargetPose": "smarts.controllers.target_pose:TargetPose",
        "Trajectory": "smarts.controllers.trajectory_tracking:TrajectoryTracking",
        "MultiTargetPose": "smarts.controllers.multi_target_pose:MultiTargetPose",
        "MPC": "smarts.controllers.model_predictive:ModelPredictive",
        "TrajectoryWithTime": "smarts.controllers.trajectory_interpolation:TrajectoryInterpolation",
        "Direct": "smarts.controllers.direct:Direct",
        "Empty": "smarts.controllers.empty:Empty",
        "RelativeTargetPose": "smarts.controllers.relative_target_pose:RelativeTargetPose",
    },
)
"""`ActionSpaceType` name -> "module:Class" of a `protocol.Controller`, which is made with a `Scene`."""
