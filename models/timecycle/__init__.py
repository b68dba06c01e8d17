"""TimeCycle: correspondence learned from the cycle-consistency of time (Wang et al. 2019)."""
