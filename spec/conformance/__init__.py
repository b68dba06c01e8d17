"""The conformance suite: valid data worked out by hand, and named ways of breaking it."""
