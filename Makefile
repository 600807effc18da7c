# Everything runs in .venv, which is built from pyproject.toml (what is needed) and
# constraints.txt (which versions). Nothing outside this folder is changed.
#
# PYTHON       interpreter that creates .venv (3.11 or newer)
# PYTEST_ARGS  extra arguments for pytest, for example PYTEST_ARGS='-x -k bicycle'
#
# The default torch wheel carries CUDA. For the much smaller CPU wheel:
#   PIP_EXTRA_INDEX_URL=https://download.pytorch.org/whl/cpu make test

PYTHON      ?= python3
PYTEST_ARGS ?= -n auto --maxprocesses=4

VENV  := .venv
BIN   := $(VENV)/bin
STAMP := $(VENV)/.installed

MAKEFLAGS += --no-builtin-rules --no-print-directory
.SUFFIXES:
.DEFAULT_GOAL := help
.PHONY: help venv test test-fast lint reproduce results accuracy robustness closed-loops several hunt unknowns benchmark models docs clean

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-10s %s\n", $$1, $$2 }' Makefile

venv: $(STAMP) ## build or update .venv, nothing else

$(STAMP): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "$(PYTHON) is missing or older than 3.11; try: make PYTHON=python3.11 ..." >&2; exit 1; }
	@if ! $(BIN)/python -m pip --version >/dev/null 2>&1; then \
		echo "==> creating $(VENV)"; \
		$(PYTHON) -m venv --clear $(VENV); \
	fi
	@echo "==> installing pinned dependencies (minutes on the first run)"
	@$(BIN)/python -m pip install --disable-pip-version-check --quiet \
		--constraint constraints.txt --editable '.[all]'
	@touch $@

test: lint ## everything: lint, types, all tests
	@echo "==> pytest"
	@$(BIN)/python -m pytest $(PYTEST_ARGS)

test-fast: $(STAMP) ## tests not marked slow
	@echo "==> pytest (not slow)"
	@$(BIN)/python -m pytest -m "not slow" $(PYTEST_ARGS)

lint: $(STAMP) ## ruff and mypy, changing nothing
	@echo "==> ruff check"
	@$(BIN)/python -m ruff check .
	@echo "==> ruff format --check"
	@$(BIN)/python -m ruff format --check .
	@echo "==> mypy"
	@$(BIN)/python -m mypy
	@$(BIN)/python -m mypy --platform win32 yawrate_env tuners

reproduce: $(STAMP) ## the paper's Table III and figures 4 to 8, made here
	@echo "==> scripts/reproduce_paper.py"
	@$(BIN)/python scripts/reproduce_paper.py --readme README.md

results: reproduce accuracy robustness closed-loops ## everything in results/: also five seeds of each agent, the nonlinear twin
	@echo "==> scripts/compare_rl.py (half an hour; trained agents in runs/rl are found again)"
	@$(BIN)/python scripts/compare_rl.py
	@echo "==> scripts/nonlinear_twin.py"
	@$(BIN)/python scripts/nonlinear_twin.py --page docs/nonlinear.md
	@echo "==> scripts/process_plants.py"
	@$(BIN)/python scripts/process_plants.py --plant fopdt --recordings 1000 --faulty 100 \
		--readme docs/plants.md
	@$(BIN)/python scripts/process_plants.py --plant fopdt --as "fopdt, 4 levels" \
		--recordings 1000 --faulty 100 \
		--arguments '{"experiment": {"levels": 4}}' --readme docs/plants.md
	@$(BIN)/python scripts/process_plants.py --plant fopdt --as "fopdt, multisine" --faulty 100 \
		--arguments '{"experiment": {"kind": "multisine"}}' --readme docs/plants.md
	@$(BIN)/python scripts/process_plants.py --plant sopdt --recordings 2000 --faulty 0 --readme docs/plants.md
	@$(BIN)/python scripts/process_plants.py --plant sopdt --as "sopdt, PIDF" --faulty 0 \
		--arguments '{"controller": "PIDF"}' --readme docs/plants.md
	@$(BIN)/python scripts/process_plants.py --plant examples/plants/wide_lag.py --corners 500 \
		--readme docs/plants.md
	@echo "==> scripts/channels.py, scripts/make_gallery.py"
	@$(BIN)/python scripts/channels.py examples/plants/wood_berry.py --readme docs/plants.md
	@$(BIN)/python scripts/make_gallery.py
	@for plant in dc_motor two_tanks pendulum; do \
		echo "==> scripts/compare_plant.py $$plant"; \
		$(BIN)/python scripts/compare_plant.py examples/plants/$$plant.py --page docs/plants.md || exit 1; \
	done
	@echo "==> scripts/recalibration.py"
	@$(BIN)/python scripts/recalibration.py
	@echo "==> scripts/leaderboard.py"
	@$(BIN)/python scripts/leaderboard.py
	@echo "==> scripts/make_results.py"
	@$(BIN)/python scripts/make_results.py

accuracy: $(STAMP) ## results/accuracy.md and its tables; about an hour
	@for study in ratios trust budget learning million minimax; do \
		echo "==> scripts/accuracy.py $$study"; \
		$(BIN)/python scripts/accuracy.py $$study || exit 1; \
	done
	@echo "==> scripts/off_design.py"
	@$(BIN)/python scripts/off_design.py
	@$(BIN)/python scripts/accuracy.py page --readme docs/accuracy.md

robustness: $(STAMP) ## results/robustness.md: who breaks where; ten minutes
	@echo "==> scripts/robustness.py"
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python scripts/robustness.py --readme docs/accuracy.md

closed-loops: $(STAMP) ## results/closed_loops.md: recordings under an old controller; five minutes
	@echo "==> scripts/closed_loops.py"
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python scripts/closed_loops.py

unknowns: $(STAMP) ## results/unknowns.md: what the paper leaves open; fifteen minutes
	@echo "==> scripts/unknowns.py"
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python scripts/unknowns.py

several: $(STAMP) ## results/several.md: what several logs of one vehicle are worth; a quarter of an hour
	@echo "==> scripts/several.py"
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python scripts/several.py

hunt: $(STAMP) ## results/log_files.md: 5,000 damaged log files; ten minutes
	@echo "==> scripts/log_files.py hunt"
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python scripts/log_files.py hunt

benchmark: $(STAMP) ## results/benchmark.md and datasets.md; wants a quiet machine
	@echo "==> scripts/benchmark.py"
	@$(BIN)/python scripts/benchmark.py
	@$(BIN)/python scripts/reproduce_paper.py
	@cp runs/fig7.png figures/fig7.png
	@echo "==> scripts/dataset_scale.py"
	@$(BIN)/python scripts/dataset_scale.py --fresh

models: $(STAMP) ## retrain the tuners that the package ships
	@for name in ts-gbm ts-ff ts-gbm-gains ts-ff-gains ts-gbm-lag ts-ff-lag ts-ff-lag-vx ts-poly-any rl; do \
		$(BIN)/python scripts/train.py $$name --out tuners/models/$$name.tuner || exit 1; \
	done

docs: $(STAMP) ## the documentation site in build/docs; two minutes
	@echo "==> sphinx"
	@$(BIN)/python -m sphinx -q -W --keep-going -b html docs build/docs

clean: ## delete caches and build outputs; keeps .venv and runs/
	@echo "==> clean"
	@rm -rf build dist docs/reference/generated *.egg-info .mypy_cache .pytest_cache .ruff_cache .hypothesis
	@find . -name $(VENV) -prune -o -name .git -prune -o \
		-type d -name __pycache__ -prune -exec rm -rf {} +
	@find . -name $(VENV) -prune -o -name .git -prune -o \
		-type f \( -name '*.nbi' -o -name '*.nbc' \) -exec rm -f {} +
