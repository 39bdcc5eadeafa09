"""Simulators that threads share."""

from __future__ import annotations

import subprocess
import sys

import pytest

SCRIPT = """
import sys, threading
import numpy as np
import heavebond as hb
assembly = hb.assemble(hb.load({model!r}))
shared = hb.Simulator(assembly, "2 s", sensitivities={names})
before = shared.run().x
found, failed, stderr = [], [], sys.stderr
def work(number):
    try:
        for k in range(3):
            simulator = shared if (number + k) % 2 or {alone} else hb.Simulator(assembly, "2 s")
            result = simulator.run()
            found.append((result.x, result[{signal!r}]))
    except BaseException as error:
        failed.append(error)
threads = [threading.Thread(target=work, args=(k,)) for k in range(4)]
[thread.start() for thread in threads]
[thread.join() for thread in threads]
assert not failed, failed
assert len(found) == 12 and all(np.array_equal(x, before) for x, _ in found)
assert sys.stderr is stderr
print("well", file=sys.stderr)
"""


@pytest.mark.parametrize(("model", "signal", "names", "alone"), [
    pytest.param("passive_rig", "crown.x", [], False, marks=pytest.mark.long), ("passive_rig", "crown.x", ["gas.c"], True),
    ("models/examples/relay.yaml", "part.y", [], False)])
def test_one_simulator_run_from_four_threads_gives_what_one_thread_gets(
        model: str, signal: str, names: list[str], alone: bool) -> None:
    """In a process of its own, as the fault would be a crash; what is written to standard error arrives there afterwards."""
    script = SCRIPT.format(model=model, signal=signal, names=names, alone=alone)
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0 and done.stderr.endswith("well\n"), (done.returncode, done.stderr)
