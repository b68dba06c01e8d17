"""Dense pixel correspondence on deformable objects: datasets, methods, scores.

The rooms of the project are imported from here: `pliant.spec`, `pliant.evaluator` and so on.
"""

__version__ = "0.1.0"
