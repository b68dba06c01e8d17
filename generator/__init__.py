"""Makes datasets: samplers, simulators, truth, rendering and the runner."""
