"""How vehicles move: from throttle, brake and steering to poses, all vehicles of all simulations in one call.

    fleet = Fleet(simulations=B, egos=N)                   # row b * N + i is ego i of simulation b
    fleet.spawn(row, "passenger", (x, y), heading, speed)  # a car in Bullet; or model="dynamic", "kinematic"
    fleet.road.friction[row] = 0.4                         # kept until written again; also normal, offset
    fleet.set_fault(row, 0, FLAT_TYRE)                     # front left
    fleet.place_boxes(b, {key: Box(...)})                  # other road users within reach of an ego
    motion = fleet.step(controls)                          # (E, 3) -> poses of all sub-steps, velocities
    fleet.wheels.slip[row]                                 # also spin, slip angle, load, forces

Data flow of one step, for cars in Bullet ten times over:

    controls, road, faults, the bodies' motion
      -> chassis.advance   one kernel call for all rows: suspension, steering, drive, brakes, tyres
      -> BulletWorld       one per simulation: takes velocities, integrates, resolves contacts, gives motion
      -> record_poses      footprints after the sub-step

Simulations in which no bodies can touch within the step skip Bullet: a kernel integrates them
(`free_motion`), and Bullet's world is synchronised when vehicles come near.

State is arrays with one row per vehicle (`layout.FleetArrays`), which the kernels take whole. A row's result
depends only on its own simulation: alone or in a batch, its bits are equal.

Alternatives considered: an object per vehicle with its own step is simpler, but its kernel calls alone would
cost as much as Bullet. Calling Bullet's C interface from the kernel would save a third, but depends on
symbols that pybullet does not guarantee. One kernel call per sub-step over all rows costs a tenth of the
step and keeps Bullet behind its public API.

Not modelled: unsprung masses, gearbox and clutch, delay of the brakes, self-aligning torque, camber, wind,
trailers, and the lean of motorcycles.
"""

from smarts.dynamics.bullet import Box
from smarts.dynamics.fleet import Fleet, MotionError
from smarts.dynamics.layout import MODELS, TYRE_MODELS
from smarts.dynamics.motion import Motion, Road, SubstepDriver, Wheels
from smarts.dynamics.parameters import VehicleParameters, vehicle, vehicle_names
from smarts.dynamics.tyre_faults import FLAT_TYRE, TyreFault

__all__ = [
    "FLAT_TYRE",
    "MODELS",
    "TYRE_MODELS",
    "Box",
    "Fleet",
    "Motion",
    "MotionError",
    "Road",
    "SubstepDriver",
    "TyreFault",
    "VehicleParameters",
    "Wheels",
    "vehicle",
    "vehicle_names",
]
