"""Competitions on existing platforms: Codabench and EvalAI bundles, and what runs in them."""
