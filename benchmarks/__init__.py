"""The commands that print the numbers of docs/results.md and docs/experiments; `python -m benchmarks` lists them."""
