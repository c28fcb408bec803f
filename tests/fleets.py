"""What tests do to the vehicles of a fleet that callers cannot."""

import numpy as np

from smarts.dynamics import single_track


def put_body(fleet, row, body):
    """Give a vehicle in Bullet another spatial motion, as `layout.BODY_SIZE` says; wheels keep theirs."""
    fleet._bullet.remove(row)
    fleet._bodies[row] = body
    fleet._motion.overhang[row] = single_track.overhang(fleet._cars[row], np.asarray(body))
    fleet._bullet.add(row)
