"""The benchmark runs, reads what it wrote, and names a peer for every figure."""

from microstage_ros.records.bench import bench


def test_every_figure_has_a_peer():
    figures = bench(messages=3000)
    assert len(figures) == 7
    for figure in figures:
        assert figure.value > 0 and figure.peer_value > 0
        assert figure.unit and figure.peer
