# Two commands do everything on a fresh machine: `make run` and `make test`. Both build .venv first.
SHELL := /bin/bash
FITS := import sys; sys.exit(sys.version_info[:2] not in ((3, 11), (3, 12)))
PYTHON ?= $(shell for name in python3 python3.12 python3.11; do \
	$$name -c '$(FITS)' 2>/dev/null && { echo $$name; break; }; done)
VENV := .venv
BIN := $(VENV)/bin
export AMENT_PREFIX_PATH := $(CURDIR)/$(VENV)
export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST
export OMP_NUM_THREADS ?= 1

.PHONY: help setup run run-linuxcnc test lint bench clean

help: ## what the targets do
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*##/\t/' | expand -t 16

setup: $(VENV)/.ready ## build .venv with ROS 2 Jazzy from the package index

$(VENV)/.ready: setup.py package.xml
	@test -n '$(PYTHON)' && $(PYTHON) -c '$(FITS)' \
		|| { echo 'Python 3.11 or 3.12 is needed; name one with: make PYTHON=/path/to/python3.11 setup' >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip' 2>/dev/null || { echo 'installing python3-venv'; \
		$$([ "$$(id -u)" = 0 ] || echo sudo) sh -c 'apt-get update -qq && apt-get install -y -qq python3-venv'; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --editable '.[ros,test]'
	@touch $@

run: setup ## start a whole machine cell on mock sensors, record it, replay it, print the table
	$(BIN)/rotary_error_monitor run

run-linuxcnc: setup ## a five-axis program on a headless LinuxCNC, with and without correction
	$(BIN)/rotary_error_monitor run-linuxcnc

test: setup lint ## lint, type check and all tests, with coverage of at least 90 %
	$(BIN)/python -m coverage erase
	$(BIN)/python -m coverage run -m pytest $(PYTEST_ARGS)
	$(BIN)/python -m coverage combine --quiet
	$(BIN)/python -m coverage report

lint: setup ## ruff and mypy
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: setup ## the figures of speed and accuracy, side by side with what a user would use instead
	$(BIN)/python -m pytest -s -q test/benchmark -o python_files='bench_*.py' --no-header

clean: ## remove what was built
	rm -rf $(VENV) build install log .coverage* *.egg-info
