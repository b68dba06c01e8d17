"""Metrics as pure functions of arrays; the protocol defines how they are averaged."""
