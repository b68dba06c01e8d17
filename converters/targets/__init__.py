"""Converts datasets into the forms of other tools: one module per target, one list of targets.

A target's module has `write(sequences, folder, options)`: it writes the sequences into an empty
folder and yields once per sequence.
"""
