"""How fast heavebond is, as ratios: `python -m benchmarks` measures, prints and writes docs/performance.md."""

import os

# what is measured is the work itself; `benchmarks.cache` measures what the cache saves of it
os.environ["HEAVEBOND_CACHE"] = "off"
