"""Providers move the vehicles that they own and fill their rows of the world.

How a traffic provider fits into a step (`Simulation.step`, one layer up):

    egos' poses at t + dt are in their rows          (owner AGENT: the provider reads these rows)
    traffic.step(states)                             (owner TRAFFIC: the provider writes these rows)

The world says who owns a vehicle, and the provider follows: it compares the owner column with what it saw
last. A hand-over is therefore one write to that column, never a call that could be forgotten, and the roster
alone issues and withdraws slots. (Considered instead: one call per transfer, which keeps the same fact in two
places; and one proposal array per provider for an arbiter to merge, which copies every row once more.)

`traffic_provider` names what the simulation may ask of any traffic provider and what it gives to it;
`sumo_traffic` is the one that SUMO drives, `sumo_rows` writes SUMO's vehicles into the world, `sumo_shadows`
shows SUMO the vehicles of others, `sumo_library` loads independent copies of libsumo.
"""
