"""Commands for this project itself: environment, tests, benchmarks."""
