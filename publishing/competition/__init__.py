"""Competitions on existing platforms: writes Codabench and EvalAI bundles.

`bundle.write_bundle` makes them from a public and a private half; the answers stay private.
"""
