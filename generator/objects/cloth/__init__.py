"""The cloth: a mass-and-spring simulator and its tiers."""
