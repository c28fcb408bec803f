"""Results on disk: a folder for each experiment, in it one for each run. `running` writes, `report` reads."""
