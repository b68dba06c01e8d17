"""What one sequence is before it is rendered: object, camera, appearance, image noise.

Everything here is plain data, drawn from one random generator and kept in `sequence.json`.
"""
