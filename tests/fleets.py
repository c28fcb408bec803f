"""Changes of a fleet's vehicles that only tests need."""

import numpy as np

from smarts.dynamics import single_track


def put_body(fleet, row, body):
    """Replace the body's state of a vehicle in Bullet (see `layout.BODY_SIZE`); wheels keep theirs."""
    fleet._bullet.remove(row)
    fleet._bodies[row] = body
    fleet._motion.overhang[row] = single_track.overhang(fleet._cars[row], np.asarray(body))
    fleet._bullet.add(row)
