"""The reference benchmark: one config, every set, method and score of it, and the table."""
