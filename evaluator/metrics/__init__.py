"""Metrics as pure functions of arrays; what is averaged over what is the protocol's business."""
