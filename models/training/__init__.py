"""The training loop, whatever is trained: steps, checkpoints, processes, the run's folder.

Dense Object Nets and TimeCycle both run on it; it knows neither.
"""
