"""PyTorch datasets over Pliant files: pairs, clips and frames."""
