"""Random diagrams from the library, right and wrong: none may end in a traceback, a hang or a silent wrong answer.

    python -m benchmarks.fuzz --seeds 100000          # goes on where it was stopped
    python -m benchmarks.fuzz --show 4711             # one diagram and what becomes of it
"""
