"""The machine of the tests of the solver serves the tests of the model too."""

from test.solver.conftest import axis, quiet  # noqa: F401
