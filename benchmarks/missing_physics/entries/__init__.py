"""Entries of the benchmark. Each module has `NAME`, `NEEDS` (packages) and `answer(case)`, the content of an answer."""
