"""Pictures for people: contact sheets, index colours, depth, tracks and match figures.

Reads datasets and answers of methods; nothing here takes part in scoring.
"""
