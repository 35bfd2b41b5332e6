# Two commands do everything on a fresh machine: `make run` and `make test`. Both build .venv first.
SHELL := /bin/bash
FITS := import sys; sys.exit(sys.version_info[:2] not in ((3, 11), (3, 12)))
# The distribution's own first, which ROS 2 is built for: Python that was built by hand (pyenv) is a fifth slower, as
# that leaves out what makes it fast unless told. Of both only one that can make a .venv, as long as there is such a one;
# a .venv that is there keeps its own.
PYTHON ?= $(shell for needed in ensurepip sys; do for name in $(wildcard $(BIN)/python) /usr/bin/python3 python3 python3.12 \
	python3.11; do $$name -c "import $$needed; $(FITS)" 2>/dev/null && { echo $$name; break 2; }; done; done)
VENV := .venv
BIN := $(VENV)/bin
export AMENT_PREFIX_PATH := $(CURDIR)/$(VENV)
export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST
export OMP_NUM_THREADS ?= 1
# Many images forbid Python to write bytecode: each process would then compile all that it loads, a second of the
# processor's time for a node. What this file starts writes it into .venv and beside its sources, once.
unexport PYTHONDONTWRITEBYTECODE

# what `make setup` installs, each file by its hash; renewed by `make lock`
LOCKS := requirements/build.lock requirements/cell.lock
UV_COMPILE := build/lock/bin/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes \
	--no-annotate --no-header --upgrade

.PHONY: help setup bytecode run run-linuxcnc test test-live test-models test-others test-samples test-bags test-models-rates test-faults-rates test-others-rates test-python312 rates lint bench fuzz soak faults faults-doc docs lock policy clean

help: ## what the targets do
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*##/\t/' | expand -t 16

setup: $(VENV)/.ready ## build .venv with ROS 2 Jazzy from the package index

$(VENV)/.ready: setup.py package.xml $(LOCKS) $(wildcard rotary_error_monitor/*/compiled/*)
	@test -n '$(PYTHON)' && $(PYTHON) -c '$(FITS)' \
		|| { echo 'Python 3.11 or 3.12 is needed; name one with: make PYTHON=/path/to/python3.11 setup' >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip' 2>/dev/null || { echo 'installing python3-venv'; \
		$$([ "$$(id -u)" = 0 ] || echo sudo) sh -c 'apt-get update -qq && apt-get install -y -qq python3-venv'; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --no-compile --require-hashes -r requirements/build.lock
	@# The package itself, of which most is compiling, beside what it needs, of which most is unpacking.
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation --editable . & package=$$!; \
	$(BIN)/python -m pip install --quiet --no-compile --require-hashes --no-build-isolation -r requirements/cell.lock; \
	cell=$$?; wait $$package && exit $$cell
	@$(BIN)/python -m pip check
	@$(BIN)/python -c "$$LOAD"
	@touch $@

# Bytecode of all that is installed takes as long as installing it: that of what the package loads is enough, and is
# there before ten nodes start at once, also where Python may not write it later. What loads nothing (the compiled
# kernels, parts for libraries that are not installed) is left out.
define LOAD
import contextlib, importlib, pkgutil, rotary_error_monitor as package
for each in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
    with contextlib.suppress(ImportError):
        each.name.endswith("__main__") or importlib.import_module(each.name)
endef
export LOAD

# Processes of the package start a tenth sooner.
bytecode: setup
	@$(BIN)/python -m compileall -q rotary_error_monitor test

run: bytecode ## start a whole machine cell on mock sensors, record it, replay it, print the table
	$(BIN)/rotary_error_monitor run

run-linuxcnc: bytecode ## a five-axis program on a headless LinuxCNC, with and without correction
	$(BIN)/rotary_error_monitor run-linuxcnc

# Tests of running processes run in a real-time class where that is allowed, as the processes of a machine cell should.
# What computes beside them gets what they leave.
ON_TIME := $(shell chrt --rr 1 true 2>/dev/null && echo chrt --rr 1)
BESIDE := $(shell chrt --idle 0 true 2>/dev/null && echo chrt --idle 0)
LIVE := $(addprefix test/,commissioning/test_live.py faults/clock faults/live linuxcnc_controller linuxcnc_demonstration mock_cell \
	network nodes security supervision testing)
# Rates over many seeds compute for minutes, and coverage, which others give, would treble that: they come without it, as
# do the tests of what is no part of the package.
CELL_RATES := $(addprefix test/,fuzz soak world test_lacking_recordings.py bags/test_writer.py commissioning/test_command.py \
	commissioning/test_travel.py description/test_configurations.py $(addprefix faults/test_, \
	begin.py calibrated.py ends.py fast_stages.py few_heads.py gaps.py machine_faults.py page.py recordings.py responses.py sampled_commands.py \
	undescribed_motion.py zero.py) \
	$(addprefix pipeline/test_,command_belief.py estimation.py radial_heights.py reversals.py uncertain_responses.py) \
	$(addprefix recordings/test_,cells.py long_recordings.py measured_curves.py))
FAULT_RATES := $(filter test/faults/%,$(CELL_RATES))
MODEL_RATES := $(addprefix test/,blind_check analysis/test_trend.py benchmark/test_power.py \
	$(addprefix calibration/test_,assembly_tables.py axis_lines.py axis_table.py \
	collimator_rates.py head_comparison.py identification.py machine_rates.py steps.py straightness_bounds.py \
	yaml_text.py) \
	$(addprefix commissioning/test_,coarse_heads.py graduated.py late_instruments.py) faults/test_common_zero.py \
	$(addprefix gap/test_,cases.py gross_errors.py) \
	$(addprefix kinds/,machine/test_diagnosis.py machine/test_noise_level.py machine/test_warming.py quadrature/test_problem.py) \
	$(addprefix kinds/stage/test_,arc.py diagnosis.py no_gap.py stretches.py without_heads.py) \
	$(addprefix metrology/test_,axis_fits.py description_check.py) cases/test_cases.py)
# Rates that take longest are for whoever changes what they are of, and before a release: `make rates`.
SWEPT := $(addprefix test/,$(addprefix analysis/test_,motion.py probes.py) benchmark/test_ablation.py \
	$(addprefix calibration/test_,assembly_contradictions.py assembly_table_rates.py axis_table_rates.py \
	flatness_bound_rates.py flatness_bounds.py machine_sweep.py straightness_contradictions.py straightness_rates.py \
	straightness_sweep.py) $(addprefix cases/test_,departures.py mimics.py) \
	$(addprefix commissioning/test_,measured_curves.py rates.py) \
	$(addprefix faults/test_,contradicted_autocollimator.py drifting_heads.py few_counts.py late_heads.py listed_sensors.py one_head.py slow_autocollimators.py stuck_command.py tilt_sensors.py \
	without_heads.py) gap/test_bounds.py kinds/mount/test_departures.py \
	$(addprefix kinds/stage/test_,admission.py gradual.py gross_readings.py listed_sensors.py motion.py play.py rounding.py \
	slow_noise.py stuck_thermometers.py thermometers.py tilt_sensors.py told_departures.py unknown.py waves.py \
	without_autocollimator.py) machine/test_uncertainty_rates.py \
	$(addprefix metrology/test_,assembly.py positioning_bound_rates.py positioning_bounds.py spindle_figures.py surface_range_rates.py) \
	$(addprefix pipeline/test_,listed_sensors.py listed_tilt.py stage_files.py) \
	$(addprefix recordings/test_,compare_bounds.py compare_rates.py) \
	$(addprefix reproduction/test_,lou2019.py pan2013.py pan2013_rates.py zhou2023.py))
RATES := $(CELL_RATES) $(MODEL_RATES) $(SWEPT)
# `make test` takes a quarter of the random stages that these draw (test/draws.py), `make rates` all of them.
DRAWN := $(addprefix test/,analysis/test_trend.py analysis/test_whole_recording.py bags/test_writer.py blind_check/test_blind_check.py \
	$(addprefix calibration/test_,axis_table.py collimator_rates.py) cases/test_cases.py \
	$(addprefix commissioning/test_,command.py late_instruments.py travel.py) \
	$(addprefix faults/test_,all_late.py begin.py beyond_limits.py calibrated.py common_zero.py ends.py far_commands.py fast_stages.py \
	few_heads.py gaps.py giving_drives.py heads_clock.py heads_left.py machine_faults.py recordings.py recovery.py responses.py sampled_commands.py \
	own_motion.py sampled_heads.py scattered_samples.py spiking_heads.py stuck_axis.py two_faults.py unchecked_probes.py) $(addprefix kinds/mount/test_,periods.py problem.py slow_noise.py) \
	$(addprefix kinds/machine/test_,departures.py warming.py) $(addprefix kinds/quadrature/test_,noise.py problem.py) \
	noise/test_listed_noise.py \
	$(addprefix kinds/stage/test_,added_forms.py arc.py braked.py diagnosis.py forces.py gain_over_time.py jumping_thermometers.py late_thermometers.py no_gap.py noise_by_speed.py one_head.py \
	rounding_thermometers.py sold_load_cells.py targets.py) \
	nodes/test_stage_files.py $(addprefix pipeline/test_,common_turns.py estimation.py joint_checks.py joint_velocities.py) recordings/test_measured_curves.py)
SAMPLES := $(addprefix test/,faults metrology pipeline)
BAGS := $(addprefix test/,bags recordings signals)
MODELS := $(addprefix test/,effects gap kinds machine noise sensors twin)

# What is marked `long` shows in minutes what others show in seconds: it is for `make rates`, and SWEEPS=1 make test-live.
PYTEST = -m pytest $(PYTEST_ARGS) $(if $(SWEEPS),,-m 'not long') $(addprefix --ignore=,$(1)) $(2)
# Coverage takes half as long again as the tests alone: COVERAGE=no leaves it out, as continuous integration does.
COVERAGE ?= yes
MEASURED := $(filter yes,$(COVERAGE))
COVERED := $(BIN)/python $(if $(MEASURED),-m coverage run)

# What failed stands once more at the end, where half an hour of output ends: whoever reads only that sees it.
FAILED := build/failed_tests.txt
# All at once, each of about as much work as any other, so that none is left to run alone: the live ones mostly wait.
PARTS := test-live test-others test-samples test-bags test-faults-rates test-others-rates test-models-rates test-models lint
test: bytecode ## lint, type check and all tests, with coverage of at least 90 % (ALSO=test-python312: that beside them)
	$(if $(MEASURED),$(BIN)/python -m coverage erase)
	@mkdir -p $(dir $(FAILED)) && : > $(FAILED)
	FAILED_TESTS=$(CURDIR)/$(FAILED) $(MAKE) --no-print-directory --jobs 10 --keep-going --output-sync=target $(PARTS) $(ALSO) \
		|| { cat $(FAILED); exit 1; }
	$(if $(MEASURED),$(BIN)/python -m coverage combine --quiet)
	$(if $(MEASURED),$(BIN)/python -m coverage report)

test-live:
	$(ON_TIME) $(COVERED) $(call PYTEST,,$(LIVE))

test-models:
	$(BESIDE) $(COVERED) $(call PYTEST,$(RATES),$(MODELS))

test-samples:
	$(BESIDE) $(COVERED) $(call PYTEST,$(LIVE) $(RATES),$(SAMPLES))

test-bags:
	$(BESIDE) $(COVERED) $(call PYTEST,$(LIVE) $(RATES),$(BAGS))

test-others:
	$(BESIDE) $(COVERED) $(call PYTEST,$(LIVE) $(SAMPLES) $(BAGS) $(MODELS) $(RATES))

test-models-rates:
	$(BESIDE) $(BIN)/python $(call PYTEST,,$(MODEL_RATES))

test-faults-rates:
	$(BESIDE) $(BIN)/python $(call PYTEST,,$(FAULT_RATES))

test-others-rates:
	$(BESIDE) $(BIN)/python $(call PYTEST,,$(filter-out $(FAULT_RATES),$(CELL_RATES)))

rates: setup ## rates over many seeds that take too long for `make test` (SWEEPS=1 make test-live: all of a newcomer's cases)
	SWEEPS=1 $(BIN)/python -m pytest -o faulthandler_timeout=0 $(PYTEST_ARGS) $(SWEPT) $(DRAWN)
	SWEEPS=1 $(BIN)/python -m pytest -o faulthandler_timeout=0 $(PYTEST_ARGS) -m long $(addprefix --ignore=,$(LIVE) $(SWEPT) $(DRAWN)) test

# What computes without processes, and beside it the nodes' life cycle, whose processes have to answer in time.
# The machine model, which uses nothing of Python, is compiled for one width of vectors there: in a third of the time.
PYTHON312 ?= python3.12
IN_312 := $(addprefix test/,bags/test_reader.py codec description/test_wire.py metrology/test_encoder_heads.py signals/test_resampling.py)
test-python312: ## the same packages with Python 3.12, in build/python312, and a part of the tests there
	CC='$(CC) -DENTRY=ENTRY_ONCE' $(BESIDE) $(MAKE) --no-print-directory setup VENV=build/python312 PYTHON=$(PYTHON312)
	AMENT_PREFIX_PATH=$(CURDIR)/build/python312 $(BESIDE) build/python312/bin/python -m pytest -q $(PYTEST_ARGS) $(IN_312)
	AMENT_PREFIX_PATH=$(CURDIR)/build/python312 $(ON_TIME) build/python312/bin/python -m pytest -q $(PYTEST_ARGS) test/nodes/test_managed.py

lint: setup ## ruff and mypy
	$(BESIDE) $(BIN)/ruff check .
	$(BESIDE) $(BIN)/ruff format --check .
	$(BESIDE) $(BIN)/mypy

fuzz: setup ## damaged bags, YAML and CSV files for FUZZ_MINUTES (10): only clean errors; what fails goes to test/fuzz/corpus
	$(BIN)/python -m pytest -s -q test/fuzz -o python_files='fuzz_*.py' --no-header

bench: setup ## the figures of speed and accuracy, side by side with what a user would use instead
	$(BIN)/python -m pytest -s -q test/benchmark -o python_files='bench_*.py' --no-header

lock: ## renew what is installed: the newest versions that setup.py allows, with their hashes
	$(PYTHON) -m venv build/lock
	build/lock/bin/python -m pip install --quiet --require-hashes -r requirements/tools.lock
	$(UV_COMPILE) setup.py $(addprefix --extra ,ros metrics trend dashboard opcua notebook bench test) -o requirements/cell.lock
	$(UV_COMPILE) requirements/build.in -c requirements/cell.lock -o requirements/build.lock
	sed -n '/"docs": \[/,/\]/s/.*"\(.*\)",/\1/p' setup.py | $(UV_COMPILE) - -o requirements/docs.lock
	$(UV_COMPILE) requirements/tools.in -o requirements/tools.lock

policy: setup ## write the SROS2 policy anew from the wire contract
	$(BIN)/rotary_error_monitor security policy > config/security/policy.xml

DOCS := build/docs
docs: setup ## the documentation as a site, build/site/index.html, to be read without network
	$(PYTHON) -m venv $(DOCS)/tools
	$(DOCS)/tools/bin/python -m pip install --quiet --require-hashes -r requirements/docs.lock
	ROS_AUTOMATIC_DISCOVERY_RANGE=OFF PYTHONPATH=doc $(BIN)/python -m website.staging $(DOCS)
	PYTHONPATH=doc $(DOCS)/tools/bin/python -m website.flowcharts $(DOCS)/pages
	NO_MKDOCS_2_WARNING=1 $(DOCS)/tools/bin/mkdocs build --quiet --clean --strict --config-file $(DOCS)/mkdocs.yml --site-dir ../site
	PYTHONPATH=doc $(BIN)/python -m website.checking build/site

soak: setup ## a million blocks, 10,000 turns, and nodes on simulated time: nothing lost, no memory kept (half an hour)
	$(BIN)/python -m pytest -s -q test/soak -o python_files='soak_*.py' --no-header

faults: setup ## faults put into recordings of random stages, FAULT_SEEDS (20) of each, from FAULT_FIRST (1) on: what is published wrong
	$(BIN)/python -m pytest -s -q test/faults -o python_files='sweep_*.py' --no-header

faults-doc: setup ## write doc/faults.md anew from the tests
	PYTHONPATH=test $(BIN)/python -m faults.page

clean: ## remove what was built
	rm -rf $(VENV) build install log .coverage* *.egg-info rotary_error_monitor/*/_kernel.*
