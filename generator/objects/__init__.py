"""The objects: how ropes and cloths are shaped, simulated and described, tier by tier.

`tiers` finds a tier by its name; `rope` and `cloth` return a `SceneObject` for a random stream.
"""
