"""Which worlds an environment shows when: training counts from 0 on."""

EVALUATION_WORLDS = 1_000_000
"""First one of evaluations during training, by which checkpoints are selected."""
REPORTED_WORLDS = 2_000_000
"""First one of reported scores."""
