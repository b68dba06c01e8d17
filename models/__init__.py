"""Learned methods: networks, losses, trainers, and their matchers."""
