"""What produces every number in docs/results.md; `python -m benchmarks` runs all, or the ones named."""
