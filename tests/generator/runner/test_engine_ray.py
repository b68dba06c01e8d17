from __future__ import annotations

from pathlib import Path

import pytest

from pliant.generator.runner.engine_ray import RayEngine
from pliant.generator.runner.run import generate
from tests.generator.runner import standin
from tests.generator.runner.standin import digests, make


@pytest.fixture
def local_ray(monkeypatch):
    """Ray, whose workers can import the stand-in."""
    ray = pytest.importorskip("ray")
    monkeypatch.setenv("PYTHONPATH", str(Path(standin.__file__).parents[3]))
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    monkeypatch.setenv("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    return ray


@pytest.fixture
def cluster(local_ray):
    """A local Ray of two CPUs."""
    ray = local_ray
    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
    yield ray
    ray.shutdown()


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::ResourceWarning")  # Ray leaves its log files open
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_local_ray_of_two_makes_the_same_bytes(uninterrupted, cluster, tmp_path):
    out = tmp_path / "set"
    faults = {"rope-test-000000": "raise", "rope-train-000001": "once"}
    summary = make(out, engine=RayEngine(2), faults=faults)
    # One sequence always raises: recorded. One kills its worker once: Ray made it again.
    assert [each.id for each in summary.failed] == ["rope-test-000000"]
    assert "no such knot" in summary.failed[0].error
    assert summary.sequences == 5
    # The driver starts again, and goes on.
    config = standin.small_config()
    summary = generate(config, out, engine="ray", workers=2, open_maker=standin.maker(config, out))
    assert summary.made == 1
    assert digests(out) == uninterrupted
    assert cluster.is_initialized()  # the engine leaves a cluster alone that it did not start


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::ResourceWarning")
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_lost_node_costs_no_sequence(uninterrupted, local_ray, tmp_path):
    """Of two nodes one is killed while both work: the other makes all that is left."""
    cluster_utils = pytest.importorskip("ray.cluster_utils")
    cluster = cluster_utils.Cluster(
        initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False}
    )
    node = cluster.add_node(num_cpus=1)
    local_ray.init(address=cluster.address, log_to_driver=False)
    used: list[float] = []

    def lose_a_node(state):
        if state.sequences == 1 and not used:
            used.append(local_ray.cluster_resources()["CPU"])
            cluster.remove_node(node, allow_graceful=False)

    try:
        out = tmp_path / "set"
        summary = make(out, engine=RayEngine(2), frame_s=0.5, progress=lose_a_node)
        assert used == [2.0]
        assert summary.failed == ()
        assert digests(out) == uninterrupted
    finally:
        local_ray.shutdown()
        cluster.shutdown()
