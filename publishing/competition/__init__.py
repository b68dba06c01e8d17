"""Competitions on Codabench: `bundle.write_bundle` makes a bundle of a public and a private half.

Codabench alone sees the answers. A challenge on a server of one's own is `pliant challenge`.
"""
