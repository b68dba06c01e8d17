# make demo: a small benchmark, rendered, answered, scored and reported in ./demo
# make docs: the documentation site, without network access, in build/site
# make test: lint, types, tests
# make test-all: the same with the tests that take minutes (marker `long`), and their coverage
# make pythons: environments of the base install on Python 3.12 and 3.13, which one test compares
# make fuzz SECONDS=60: coverage-guided fuzzing of every reader of files
# make mutants SAMPLE=100: so many mutants of each target of tests/mutation (SAMPLE= for all)
# They make .venv from constraints.txt when it is missing; Python 3.11 is all they need.

PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
OUT ?= demo

SECONDS ?= 60
SAMPLE ?= 100

# Compiled modules are kept: the tests start hundreds of processes, which then import faster.
export PYTHONDONTWRITEBYTECODE :=

# The tests sync thousands of small files: in memory, where Linux has a folder with 4 GB for it.
# A test that passes leaves none of them.
MEMORY := $(shell df -kP /dev/shm 2>/dev/null | awk 'END {if ($$4 > 4e6) print "/dev/shm"}')
unit unit-all: export TMPDIR := $(or $(MEMORY),$(TMPDIR),/tmp)

.PHONY: demo docs test test-all pythons fuzz mutants lint types unit unit-all venv clean

venv: $(VENV)/.installed

$(VENV)/.installed: pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[all,dev]'
	if command -v npm >/dev/null; then npm ci --silent --prefix spec/examples; fi # a writer in JavaScript
	touch $@

demo: venv
	$(BIN)/pliant demo --out $(OUT)

docs: venv
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

test: venv lint
	$(MAKE) -j 2 types unit

test-all: venv lint
	$(MAKE) -j 2 types unit-all

lint: venv
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: venv
	$(BIN)/mypy

unit: venv
	$(BIN)/pytest -n 2 --dist worksteal -m 'not long'

unit-all: venv
	$(BIN)/pytest -n 2 --dist worksteal -o timeout=1800 --cov --cov-report=term --cov-report=json:build/coverage.json

pythons:
	for version in 3.12 3.13; do \
		python$$version -m venv $(VENV)-$$version && \
		$(VENV)-$$version/bin/python -m pip install --quiet --disable-pip-version-check 'pyarrow<26' -e . || exit; \
	done

fuzz: venv
	$(BIN)/python -m tests.fuzz --seconds $(SECONDS)

mutants: venv
	$(BIN)/python -m tests.mutation $(if $(SAMPLE),--sample $(SAMPLE))

clean:
	rm -rf $(VENV) build dist *.egg-info
