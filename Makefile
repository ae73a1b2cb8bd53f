# make run    set everything up and run the double pendulum: make run ARGS="-p mechanism:=rod_pendulum -p rerun:=spawn"
# make test   set everything up and run every test, ruff and mypy: all at once, then those with real nodes one by one
# make setup  only set up: .venv with all that is needed, with the ROS 2 wheels unless a ROS 2 environment is sourced
# make gallery  draw the mechanisms that ship anew, for docs/gallery.md
# make bench  measure start-up, and speed and accuracy beside other simulators: make bench ARGS="--mechanisms four-bar"
# make clean  remove .venv and what was built

VENV := .venv
BIN := $(VENV)/bin
BENCH := .venv-bench
ARGS ?=

.PHONY: setup run test lint gallery bench clean

setup: $(VENV)/ready $(VENV)/interfaces

$(VENV)/ready: setup.py scripts/setup_venv
	scripts/setup_venv $(VENV)

$(VENV)/interfaces: $(VENV)/ready $(wildcard test/ros_interfaces/*.py test/ros_interfaces/*/*/*)
	$(BIN)/python -m test.ros_interfaces.build $@

run: setup
	@$(BIN)/sim_node --ros-args $(ARGS)

NODES := test/system test/examples

test: setup lint
	$(BIN)/python -m pytest --numprocesses auto --dist worksteal $(NODES:%=--ignore %)
	$(BIN)/python -m pytest $(NODES)

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

gallery: setup
	$(BIN)/python -m mbd_sim.drawing.gallery docs

bench: setup $(BENCH)/ready
	$(BIN)/python benchmarks/startup.py
	$(BENCH)/bin/python -m benchmarks $(ARGS)

$(BENCH)/ready: setup.py benchmarks/setup_venv
	benchmarks/setup_venv $(BIN)/python $(BENCH)

clean:
	rm -rf $(VENV) $(BENCH) build install log dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
