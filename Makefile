# Everything a fresh machine needs is Python 3.11 or newer and this file: each target makes .venv and installs what it uses.
PYTHON ?= python3
VENV := .venv
INSTALLED := $(VENV)/.installed
TRAINING_INSTALLED := $(VENV)/.training-installed
# The version the tests are made with; left to itself pip takes the newest, which brings gigabytes for graphics cards.
TORCH := torch==2.13.0
BENCH_VENV := .venv-bench
BENCH_INSTALLED := $(BENCH_VENV)/.installed
# Two test processes of one BLAS thread each are faster than threads that fight for the same cores.
ONE_THREAD := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1

.PHONY: demo test test-slow lint types bench bench-association bench-perception bench-reid format clean

demo: $(INSTALLED)
	$(VENV)/bin/passerby demo -o demo

test: $(TRAINING_INSTALLED)
	$(ONE_THREAD) $(VENV)/bin/python -m pytest -n 2 -m "not slow"

test-slow: $(TRAINING_INSTALLED)
	$(ONE_THREAD) $(VENV)/bin/python -m pytest -n 2 -m slow

lint: $(INSTALLED)
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .

format: $(INSTALLED)
	$(VENV)/bin/ruff check --fix .
	$(VENV)/bin/ruff format .

types: $(TRAINING_INSTALLED)
	$(VENV)/bin/mypy

bench: $(BENCH_INSTALLED)
	$(BENCH_VENV)/bin/python benchmarks/run.py

bench-association: $(INSTALLED)
	$(VENV)/bin/python benchmarks/run.py --only association

bench-perception: $(INSTALLED)
	$(VENV)/bin/python benchmarks/run.py --only perception --scenes build/scenes

bench-reid: $(TRAINING_INSTALLED)
	$(VENV)/bin/python benchmarks/run.py --only reid --scenes build/scenes

clean:
	rm -rf $(VENV) $(BENCH_VENV)

$(INSTALLED): pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(None if sys.version_info >= (3, 11) else "Python 3.11 or newer is needed: make PYTHON=python3.11 ...")'
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check -e '.[dev]'
	touch $@

$(TRAINING_INSTALLED): $(INSTALLED)
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check '$(TORCH)' -e '.[dev,reid]'
	touch $@

$(BENCH_INSTALLED): pyproject.toml
	$(PYTHON) -m venv $(BENCH_VENV)
	$(BENCH_VENV)/bin/python -m pip install --quiet --disable-pip-version-check '$(TORCH)' -e '.[bench,reid]'
	touch $@
