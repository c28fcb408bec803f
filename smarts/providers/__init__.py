"""Providers move the vehicles that they own and write the vehicles' rows of the world.

A traffic engine's part of a step (`Simulation.step`, one layer up):

    egos' poses at t + dt are in their rows          (the engine reads the rows of other owners)
    traffic.step(env_mask)                           (the engine writes the rows that it owns)

The owner column assigns each vehicle to a provider. Providers compare the column with its values of the last
step, so a hand-over is one write to that column; only the registry issues and withdraws slots. (Alternatives
considered: one call per transfer, which stores the same fact twice; one proposal array per provider that an
arbiter merges, which copies every row.)

`traffic_engine` is the protocol of traffic engines: arrays of all simulations at once, in and out.
(Alternative considered: a protocol for one simulation and a loop over simulations, which rules out engines
that step thousands of simulations in one kernel.) `smarts.types.traffic` lists the engines, a scenario or
`Options.traffic_engine` chooses one, and `traffic_engines` constructs them: `native`, one kernel for all
simulations, and `sumo_engine`, which steps one copy of SUMO per simulation. `sumo_traffic` runs one of these,
`sumo_rows` writes SUMO's vehicles into the world, `sumo_shadows` shows other providers' vehicles to SUMO, and
`sumo_library` loads independent copies of libsumo.
"""
