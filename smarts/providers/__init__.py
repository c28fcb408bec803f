"""Providers move the vehicles that they own and fill their rows of the world.

How a traffic engine fits into a step (`Simulation.step`, one layer up):

    egos' poses at t + dt are in their rows          (another's: the engine reads these rows)
    traffic.step(env_mask)                            (its own: the engine writes these rows)

The owner column assigns each vehicle to a provider, and the provider follows: it compares the column with its
last copy. A hand-over is therefore one write to that column, never a call that could be forgotten, and the
registry alone issues and withdraws slots. (Considered instead: one call per transfer, which keeps the same
fact in two places; and one proposal array per provider for an arbiter to merge, which copies every row once
more.)

`traffic_engine` says what the simulation asks of a traffic engine: all simulations at once, arrays in and
out. (Considered instead: an interface for one simulation, and a loop over simulations above it; then an
engine that steps thousands of simulations in one kernel has no place to do so.) `smarts.types.traffic` lists
the engines, a scenario or `Options.traffic_engine` chooses one, and `traffic_engines` makes them. They are
`constant_speed`, the example, and `sumo_engine`, which steps a copy of SUMO for each simulation:
`sumo_traffic` drives one, `sumo_rows` writes SUMO's vehicles into the world, `sumo_shadows` shows SUMO the
vehicles of others, `sumo_library` loads independent copies of libsumo.
"""
