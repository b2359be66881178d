"""flexlink as a solver of other people's benchmarks."""
