# `make demo` and `make test` set everything up by themselves; Python >= 3.11, make and git are all they need.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# installed once, and again when the dependencies change
READY := $(VENV)/.ready
# versions of all packages, so that every machine has the same environment; `make CONSTRAINTS=` takes the newest ones
CONSTRAINTS ?= .ci/constraints.txt
# files with tests marked `long`: the others need not be read for `make test-long`
LONG := $(shell grep -l 'mark\.long\|partly' tests/test_*.py)

# bytecode is kept: without it every worker, and every command that a test starts, compiles all that it imports
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo quick lowest test test-long test-all test-slow coverage lint types pages docs bench scaling fuzz mutants false-alarms confusion detectability compensator clean

demo: $(READY)
	$(BIN)/heavebond demo --output demo

# one worker a processor; each takes a stretch of files, and what is left of the other when its own is done
test: $(READY)
	$(BIN)/python -m pytest -n logical --dist worksteal -m "not slow and not long"

# what is left out of `make test`: the pages' blocks, whole studies and diagnoses
test-long: $(READY)
	$(BIN)/python -m pytest -n logical --dist worksteal -m "long and not slow" $(LONG)

# both in one run, so that each file is read once and the processors wait once for the last test
test-all: $(READY)
	$(BIN)/python -m pytest -n logical --dist worksteal -m "not slow"

# under a minute: language, units, structure, start, verdict, and the library beside its formulas
QUICK := expression units lists language names medium grounding incidence states newton corners quick signals saved \
	measurements records_screening metrics slips stability linearisation energy validity limits numerals quoting \
	output_files presentation painting cmc_ahc library_*
quick: $(READY)
	$(BIN)/python -m pytest -n logical --dist worksteal -m "not slow and not long" $(foreach name,$(QUICK),tests/test_$(name).py)

# `make quick` with the lowest versions of all dependencies and extras that pyproject.toml declares
lowest:
	$(MAKE) VENV=.venv-lowest CONSTRAINTS=.venv-lowest.txt quick

.venv-lowest.txt: pyproject.toml tests/lowest.py
	$(PYTHON) tests/lowest.py > $@

test-slow: $(READY)
	$(BIN)/python -m pytest -m slow

# lines that no test of `make test` runs; the pages' blocks and whole diagnoses run others
coverage: $(READY)
	$(BIN)/python -m pytest -n logical --dist worksteal -m "not slow and not long" --cov --cov-report term-missing

lint: $(READY)
	$(BIN)/ruff check .

types: $(READY)
	$(BIN)/mypy

# docs/components/ from the component files; after every change of these
pages: $(READY)
	$(BIN)/python docs/component_pages.py

# site/, from docs/: a site that opens from its folder, without a network
docs: $(READY)
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs --quiet build --strict

bench: $(READY)
	$(BIN)/python -m benchmarks

# docs/scaling.md: what a million runs cost
scaling: $(READY)
	$(BIN)/python -m benchmarks.scaling

# 100 000 random diagrams: hours; goes on where it was stopped
fuzz: $(READY)
	$(BIN)/python -m benchmarks.fuzz

# 20 000 mutants of the bundled files: hours; goes on where it was stopped
mutants: $(READY)
	$(BIN)/python -m benchmarks.fuzz.mutate

# the study of the diagnosis: hours; each goes on where it was stopped
false-alarms confusion detectability compensator: $(READY)
	$(BIN)/python -m benchmarks.diagnosis.$(subst -,_,$@)
	$(BIN)/python -m benchmarks.diagnosis.page

# --no-compile: Python compiles what is imported, a small part of all packages
$(READY): pyproject.toml $(CONSTRAINTS)
	@$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "heavebond needs Python 3.11 or newer; say which one with: make PYTHON=python3.11 ...")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile $(if $(CONSTRAINTS),--constraint $(CONSTRAINTS)) --editable '.[dev]'
	@touch $(READY)

clean:
	rm -rf $(VENV) .venv-lowest .venv-lowest.txt demo site .pytest_cache .mypy_cache .ruff_cache
