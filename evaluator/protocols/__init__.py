"""Protocols: frozen, named JSON files that say what is scored and how, and their reader."""
