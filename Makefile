# Each target makes the environment it needs in .venv; nothing has to be installed or active before.
#   make demo    simulate, generate, identify, validate, report, on a two-link arm
#   make test    style, types and all tests
# PYTHON is the interpreter that .venv is made from (3.11 or later).

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt
DEMO := demo
WORKERS ?= 2

.DEFAULT_GOAL := help
.PHONY: help demo test test-slow lint docs wheel benchmark clean

help:
	@sed -n 's/^#   //p' Makefile
	@echo "make lint, test-slow, docs, wheel, benchmark, clean"

$(VENV)/made:
	$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "symid needs Python 3.11 or later, set PYTHON")'
	$(PYTHON) -m venv $(VENV)
	@touch $@

$(VENV)/core: $(VENV)/made pyproject.toml constraints.txt
	$(INSTALL) --editable .
	@touch $@

$(VENV)/dev: $(VENV)/made pyproject.toml constraints.txt
	$(INSTALL) --editable '.[dev]'
	@touch $@ $(VENV)/core

$(VENV)/docs: $(VENV)/made pyproject.toml constraints.txt
	$(INSTALL) --editable '.[docs]'
	@touch $@ $(VENV)/core

demo: $(VENV)/core
	$(BIN)/symid demo --output $(DEMO) --force

lint: $(VENV)/dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# The tests come last, so that pytest's closing line is the last one.
test: lint
	$(BIN)/python -m pytest --numprocesses $(WORKERS)

# Every URDF of a package of seventy; prints a table.
test-slow: $(VENV)/dev
	$(BIN)/python -m pytest -m slow --capture=no --quiet tests/oracle/test_urdf_robots.py

docs: $(VENV)/docs
	$(BIN)/sphinx-build -W --keep-going -b html docs docs/_build/html

wheel: $(VENV)/made
	$(BIN)/python -m pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir dist .

benchmark: $(VENV)/core
	$(BIN)/python benchmarks/startup.py

clean:
	rm -rf $(VENV) build dist docs/_build $(DEMO) .mypy_cache .ruff_cache .pytest_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
