"""The modules and the bundled library, read once by the process of which the studio's workers are copies."""

from __future__ import annotations

import contextlib

from heavebond.core.errors import HeavebondError
from heavebond.studio import bench as bench
from heavebond.studio.palette import bundled_entries

with contextlib.suppress(HeavebondError):  # of a file that is being written: each worker reads what is left
    bundled_entries()
