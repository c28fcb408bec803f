"""A multi-agent driving simulator whose road users can all be intelligent.

Layers, lowest first; a module imports its own package or a lower layer (`tests/test_layers.py`):

    0  errors, registry, geometry     1  types            2  roads
    3  sstudio, agents                4  sensors, dynamics, bubbles
    5  controllers, planners          6  providers        7  sim
    8  zoo, env, envision
"""
