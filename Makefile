# Every target sets up its own virtual environment from nothing and then runs; a second run does
# not install again. Needs Python 3.11 or newer, make and a package registry.
#
#   make demo        a short RGB-D sequence with known truth, made, tracked and drawn
#   make test        the tests; make test-slow: those that take minutes
#   make lint        style, formatting and types
#   make bench       speed, as Markdown tables and plots in bench/
#   make docs        the documentation, in docs/_build/html
#   make clean       removes what the targets made, but for the environment; make distclean: that too
#
# PYTHON=... chooses the interpreter, VENV=... the folder of the environment.

PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV ?= .venv
BIN := $(VENV)/bin

.PHONY: demo test test-slow lint bench docs clean distclean
.DEFAULT_GOAL := test
.NOTPARALLEL:
.SECONDARY:

demo: $(VENV)/.with-base
	$(BIN)/edvo demo

test: $(VENV)/.with-test
	$(BIN)/python -m pytest -m "not slow" -n auto --dist loadfile \
		--no-loadscope-reorder

test-slow: $(VENV)/.with-test
	$(BIN)/python -m pytest -m slow

lint: $(VENV)/.with-lint
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy

bench: $(VENV)/.with-bench
	$(BIN)/python -m benchmarks.report -o bench
	$(BIN)/python -m pytest benchmarks --benchmark-columns=min,median,iqr,rounds \
		--benchmark-group-by=param:frames --benchmark-json=bench/pytest-benchmark.json

docs: $(VENV)/.with-docs
	$(BIN)/python -m sphinx --fail-on-warning --keep-going --quiet -b html docs docs/_build/html
	@echo "open docs/_build/html/index.html"

clean:
	rm -rf build dist docs/_build demo edvo-demo bench .benchmarks .hypothesis
	rm -rf .pytest_cache .mypy_cache .ruff_cache
	find src tests docs -name __pycache__ -type d -prune -exec rm -rf {} +

distclean: clean
	rm -rf $(VENV)

# One stamp an extra: `.with-test` says that edvo[test] is installed as pyproject.toml has it.
$(VENV)/.with-%: pyproject.toml | $(BIN)/python
	@echo "installing edvo and what 'make $(MAKECMDGOALS)' needs into $(VENV), once"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable \
		"$(if $(filter base,$*),.,.[$*])"
	@touch $@

$(BIN)/python:
	@$(or $(PYTHON),python3) -c 'import sys; sys.exit(sys.version_info < (3, 11) and \
		"edvo needs Python 3.11 or newer; name one: make PYTHON=/path/to/python3.11")'
	@$(or $(PYTHON),python3) -m venv $(VENV)
