# make run      set everything up and run the double pendulum: make run ARGS="-p mechanism:=rod_pendulum -p rerun:=spawn"
# make test     set everything up; run ruff, mypy and all tests, in parallel
# make lint     run only ruff and mypy
# make setup    create .venv with all dependencies, including the ROS 2 wheels unless a ROS 2 environment is sourced, and
#               build the message packages that only tests need; ROS=kilted takes other wheels, ROS=none does without
# make gallery  redraw the pictures and animations of the shipped mechanisms, or of some: make gallery ARGS="four_bar engine"
# make lowest   run tests with the lowest versions of all packages that setup.py allows; ARGS=--quick runs few of them
# make versions run tests with each version of Python that is found on this machine: make versions ARGS="--sessions tests-3.13"
# make docs     build the site in docs/_build/html and check every page; NOTEBOOKS=off does not execute its notebooks
# make bench    measure start-up, and compare speed and accuracy with other simulators: make bench ARGS="--mechanisms four-bar"
# make figures  write the results of make bench into docs/benchmarks.md and README.md
# make clean    remove .venv and all build products

VENV := .venv
BIN := $(VENV)/bin
BENCH := .venv-bench
DOCS := .venv-docs
SITE := docs/_build/html
ARGS ?=

.PHONY: setup run lowest versions test tests lint style types gallery docs bench figures clean

setup: $(VENV)/ready $(VENV)/interfaces
	@scripts/browser

# Set up again if ROS names other wheels than those that are installed.
other_ros := $(if $(ROS),$(if $(filter $(ROS),$(shell cat $(VENV)/ros 2>/dev/null)),,other_ros))
.PHONY: other_ros

$(VENV)/ready: setup.py scripts/setup_venv $(other_ros)
	scripts/setup_venv $(VENV) $(ROS)

# Message packages that only tests need.
$(VENV)/interfaces: $(VENV)/ready $(wildcard test/ros_interfaces/*.py test/ros_interfaces/*/*/*)
	if $(BIN)/python -c 'import rclpy' 2>/dev/null; then $(BIN)/python -m test.ros_interfaces.build $@; else mkdir -p $@; fi

run: $(VENV)/ready
	@scripts/run $(BIN) $(ARGS)

# One more than there are processors: tests with real nodes wait most of the time.
WORKERS ?= $(shell expr $$(nproc) + 1)

# mypy runs beside the tests.
test: setup style
	@$(MAKE) --no-print-directory --jobs=2 types tests

tests: setup
	$(BIN)/python -m pytest --numprocesses $(WORKERS) --dist worksteal

lint: style types

style: $(VENV)/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/ready
	$(BIN)/mypy

lowest:
	@scripts/lowest_versions $(ARGS)

versions: $(VENV)/ready
	@$(BIN)/nox --reuse-existing-virtualenvs $(ARGS)

gallery: $(VENV)/ready
	$(BIN)/python docs/gallery_pictures.py docs $(ARGS)
	$(if $(ARGS),,$(BIN)/python scripts/lab_pictures)

# Warnings are errors. NOTEBOOKS=off leaves out the outputs of the tutorials, which `make test` executes as well.
NOTEBOOKS ?= force
UNEXECUTED := -D nb_execution_mode=off -D suppress_warnings=misc.highlighting_failure
docs: $(VENV)/ready $(DOCS)/ready
	@start=$$(date +%s); $(DOCS)/bin/python -m sphinx -b html -d docs/_build/doctrees -q -W --keep-going \
	$(if $(filter off,$(NOTEBOOKS)),$(UNEXECUTED)) docs $(SITE) && \
	echo "The site was built in $$(($$(date +%s) - start)) s: $(SITE)/index.html"
	MBD_SIM_SITE=$(SITE) MBD_SIM_NOTEBOOKS=$(NOTEBOOKS) $(BIN)/python -m pytest -q -rs test/docs/test_site.py

$(DOCS)/ready: setup.py docs/setup_venv
	docs/setup_venv $(BIN)/python $(DOCS)

bench: $(VENV)/ready $(BENCH)/ready
	$(BENCH)/bin/python -m benchmarks.everything --python $(BIN)/python $(ARGS)

figures: $(BENCH)/ready
	$(BENCH)/bin/python -m benchmarks.figures

$(BENCH)/ready: setup.py benchmarks/setup_venv
	benchmarks/setup_venv $(BIN)/python $(BENCH)

clean:
	rm -rf $(VENV) $(BENCH) $(DOCS) docs/_build docs/generated build install log dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
