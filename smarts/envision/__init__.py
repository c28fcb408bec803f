"""Pictures of scenarios and episodes."""
