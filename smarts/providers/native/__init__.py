"""Native traffic: all simulations in one kernel, by SUMO's rules; `docs/develop/native.md` describes it."""
