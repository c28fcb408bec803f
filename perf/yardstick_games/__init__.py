"""Published games as vector environments; their episodes are those of the published packages."""
