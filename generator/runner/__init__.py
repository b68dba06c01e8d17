"""Runs a generation: plans tasks, makes sequences in worker processes, writes the dataset.

`run.generate` is the entry; it resumes, retries, and gives the same files for any worker count.
"""
