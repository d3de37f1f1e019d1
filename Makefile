# Everything a fresh clone needs: `make demo` and `make test` set themselves up in .venv first.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready

.PHONY: help setup demo test test-slow chaos docs wheel lint format types

help:  ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## /\t/'

setup: $(READY)  ## create .venv with the pinned versions

$(READY): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --disable-pip-version-check --quiet --constraint constraints.txt --editable '.[dev]'
	touch $(READY)

demo: $(READY)  ## answer questions about three generated apartments, offline
	$(BIN)/splatreasoner demo

test: lint types  ## lint, types and the default tests
	$(BIN)/python -m pytest --numprocesses 2 --dist loadfile

test-slow: $(READY)  ## the tests that take minutes
	$(BIN)/python -m pytest -m slow --timeout=1800

chaos: $(READY)  ## every fault done to whole runs; fills the table of docs/reliability.md
	rm -f build/chaos.jsonl && mkdir -p build
	CHAOS_OUTPUT=build/chaos.jsonl $(BIN)/python -m pytest -m chaos --timeout=900
	$(BIN)/python -m tests.jobs.chaos.table build/chaos.jsonl

docs: $(READY)  ## the pages and the API reference as HTML in docs/_build/html
	$(BIN)/python -m pip install --disable-pip-version-check --quiet --constraint constraints.txt --editable '.[docs]'
	$(BIN)/python -m sphinx --fail-on-warning --keep-going --quiet -d docs/_build/doctrees docs docs/_build/html

wheel: $(READY)  ## wheel and source archive in dist
	$(BIN)/python -m pip install --disable-pip-version-check --quiet --constraint constraints.txt build
	$(BIN)/python -m build

lint: $(READY)  ## style
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

format: $(READY)  ## rewrite in the project's style
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

types: $(READY)  ## strict mypy
	$(BIN)/mypy
