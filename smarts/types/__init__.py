"""Plain data that every layer above shares; no behaviour beyond construction and indexing."""
