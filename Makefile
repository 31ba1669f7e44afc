# Everything runs in environments inside the checkout; only Python 3.11 with venv, git and make are presumed.
#
#   make demo     install, and run the main job on a shipped example
#   make test     install everything, lint, type-check, and run every test
#   make check    ruff and mypy alone
#   make format   put the source into ruff's form
#   make bench    side-by-side speed figures
#   make verify   the issues' full figures, into docs/verification/
#   make clean    remove what the others left

.DEFAULT_GOAL := test
.DELETE_ON_ERROR:
MAKEFLAGS += --no-print-directory

unexport PYTHONPATH PYTHONHOME

PYTHON ?= $(firstword $(foreach name,python3.11 python3 python,$(shell \
	$(name) -c "import sys, venv; sys.exit(sys.version_info < (3, 11))" 2>/dev/null && echo $(name))))
PIP_INSTALL = -m pip install -qq --no-compile --disable-pip-version-check
PYTEST = -m pytest

# ---------------------------------------------------------------- environments
# The stamp `ready` is younger than everything that decides what is installed, so a second call costs nothing.

ENVIRONMENTS = .venv/ready .envs/donkeycar/ready .envs/jax/ready

# rclpy is on PyPI for one platform only; elsewhere its tests need a sourced ROS installation.
ifeq ($(shell uname -sm),Linux x86_64)
ROS2 = ros2
ENVIRONMENTS += .envs/ros2/ready
endif

.venv/bin/python .envs/donkeycar/bin/python .envs/jax/bin/python .envs/ros2/bin/python:
	@test -n "$(PYTHON)" || { echo "No Python 3.11 or later with venv was found; name one: make PYTHON=..."; exit 1; }
	$(PYTHON) -m venv --clear $(@:/bin/python=)

# What a user of the command line gets.
.venv/demo: pyproject.toml requirements/dev.txt | .venv/bin/python
	.venv/bin/python $(PIP_INSTALL) --constraint requirements/dev.txt --editable '.[plot,parquet,calibrate]'
	@touch $@

# The same, with the tests' own tools.
.venv/ready: requirements/dev.txt .venv/demo
	.venv/bin/python $(PIP_INSTALL) --requirement requirements/dev.txt
	@touch $@

# NumPy 1.26, the oldest that is promised, with the real donkeycar.  /  JAX.  /  rclpy without a ROS installation.
.envs/%/ready: requirements/%.txt pyproject.toml | .envs/%/bin/python
	.envs/$*/bin/python $(PIP_INSTALL) --requirement requirements/$*.txt --editable .
	@touch $@

.PHONY: environments
environments: $(ENVIRONMENTS)

# ------------------------------------------------------------------------ jobs

.PHONY: demo
demo: .venv/demo
	@mkdir -p out
	.venv/bin/trundle track examples/differential/run.csv --robot examples/differential/robot.yaml \
		--output out/run.tum --plot out/run.png --force
	@echo "The trajectory is in out/run.tum, the picture in out/run.png."

# Environments are made side by side. The checks then run one after the other, all of them even where one fails.
.PHONY: test
test:
	@$(MAKE) --jobs=3 environments
	@$(MAKE) --keep-going check test-jax test-donkeycar $(ROS2:%=test-%) test-main

.PHONY: test-main test-donkeycar test-jax test-ros2 # one environment's share of the tests
test-main: .venv/ready
	.venv/bin/python $(PYTEST) --numprocesses=2 --ignore=tests/donkeycar --ignore=tests/arrays --ignore=tests/ros2

# NumPy 1.26 gets every test that computes; the other array libraries live beside JAX.
COMPUTING = tests/donkeycar tests/arrays $(wildcard $(addprefix tests/test_, \
	geometry*.py kinematics*.py conventions.py records*.py odometry*.py integrate*.py integration*.py simulate*.py uncertainty.py))

test-donkeycar: .envs/donkeycar/ready
	.envs/donkeycar/bin/python $(PYTEST) $(COMPUTING) --ignore=tests/arrays/test_gradients.py \
		-k "not jax and not torch and not strict"

test-jax: .envs/jax/ready
	.envs/jax/bin/python $(PYTEST) tests/arrays

# The real node, in processes and on DDS domains of its own.
test-ros2: .envs/ros2/ready
	.envs/ros2/bin/python $(PYTEST) --numprocesses=2 --dist=loadfile tests/ros2

.PHONY: check
check: .venv/ready
	.venv/bin/ruff format --check .
	.venv/bin/ruff check .
	.venv/bin/mypy

.PHONY: format
format: .venv/ready
	.venv/bin/ruff format .
	.venv/bin/ruff check --fix .

# With today's NumPy, and beside donkeycar with the NumPy that it wants.
.PHONY: bench
bench: .venv/ready .envs/donkeycar/ready
	.venv/bin/python $(PYTEST) benchmarks
	.envs/donkeycar/bin/python $(PYTEST) benchmarks

# Full figures print what they measure. A page per test file keeps that, the verdicts, and the commit, so that what
# a change touches can be made again without the hours of all: make verify-test_slip
VERIFIED = $(basename $(notdir $(shell grep -l 'mark\.verify' tests/*.py $(ROS2:%=tests/%/*.py))))

.PHONY: verify
verify:
	@$(MAKE) --keep-going $(VERIFIED:%=verify-%)

verify-%: $(ENVIRONMENTS)
	@mkdir -p docs/verification
	@page=docs/verification/$*.md; \
	changed=$$(git diff --quiet HEAD -- . ':!docs' || echo ', with changes that are not in it'); \
	printf '# %s\n\nMade by `make %s` at commit %s.\n\n```text\n' \
		$* $@ "$$(git rev-parse --short HEAD)$$changed" > $$page; \
	$(PYTHON_OF) $(PYTEST) --quiet --no-header -m verify -rA --durations=0 $(FILE_OF) >> $$page; status=$$?; \
	echo '```' >> $$page; tail -n 2 $$page; exit $$status

FILE_OF = $(wildcard tests/$*.py tests/*/$*.py)
PYTHON_OF = $(if $(wildcard tests/ros2/$*.py),.envs/ros2,.venv)/bin/python

.PHONY: clean
clean:
	rm -rf .venv .envs .pytest_cache .mypy_cache .ruff_cache .hypothesis .benchmarks build dist out
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
