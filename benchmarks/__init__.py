"""How fast heavebond is, as ratios: `python -m benchmarks` measures, prints and writes docs/performance.md."""
