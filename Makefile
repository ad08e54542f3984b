# Each target does all the set-up that it needs, in .venv, as a plain user. PYTHON names the interpreter (3.11 or newer).
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --use-pep517

.PHONY: help setup setup-dev setup-training demo test lint format serve lock clean

help:
	@echo "make demo    three scenes: elemental image array, views before and after, a contact sheet, in demo-out/"
	@echo "make test    all tests (training tests too where torch is installed: make setup-training)"
	@echo "make lint    ruff and strict type checks (installs torch: training is checked too)"
	@echo "make serve   the HTTP service on http://127.0.0.1:8000, documented at /docs"
	@echo "make setup | setup-dev | setup-training    only the set-up; make lock    lock versions anew; make clean"

setup: $(VENV)/.run
setup-dev: $(VENV)/.dev
setup-training: $(VENV)/.training

$(VENV)/.venv:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "$(PYTHON) is older than 3.11: name a newer one, as in make PYTHON=python3.11"; exit 1; }
	@echo "== making $(VENV) with $$($(PYTHON) --version)"
	@$(PYTHON) -m venv $(VENV)
	@touch $@

$(VENV)/.run: $(VENV)/.venv requirements/run.txt pyproject.toml
	@echo "== installing what running needs (requirements/run.txt)"
	@$(PIP) --no-deps -r requirements/run.txt
	@$(PIP) --no-deps --editable .
	@touch $@

$(VENV)/.dev: $(VENV)/.run requirements/dev.txt
	@echo "== installing what tests need (requirements/dev.txt)"
	@$(PIP) --no-deps -r requirements/dev.txt
	@touch $@

$(VENV)/.training: $(VENV)/.dev requirements/training.txt requirements/spandrel.txt
	@echo "== installing what training needs (requirements/training.txt; torch is large)"
	@$(PIP) --no-warn-conflicts -r requirements/training.txt
	@$(PIP) --no-deps -r requirements/spandrel.txt
	@touch $@

demo: setup
	@echo "== reconstructing three scenes into demo-out/"
	@$(BIN)/ciir demo -o demo-out

test: setup-dev
	@echo "== running the tests"
	@$(BIN)/python -m pytest

lint: setup-training
	@echo "== ruff"
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@echo "== mypy"
	@$(BIN)/mypy

format: setup-dev
	@$(BIN)/ruff check --fix .
	@$(BIN)/ruff format .

serve: setup
	@$(BIN)/ciir serve

# Exact versions of everything, for the oldest Python that is supported. pyrender asks for PyOpenGL 3.1.0, which fails on
# Python 3.12 and newer, and works with 3.1.10: so the locks say that, and are installed without looking at what packages
# ask for. Not so training's, where torch asks for what the machine needs: pip takes the build that suits it. spandrel
# asks for torchvision, for two networks that are of no use here (see training/export/external_weights.py), and pip would bring one that
# doesn't fit every build of torch: so spandrel has a lock of its own.
COMPILE := $(BIN)/pip-compile --quiet --strip-extras --no-header --no-annotate --no-emit-index-url --no-emit-find-links \
	--no-emit-trusted-host --allow-unsafe
lock: setup-dev
	@$(COMPILE) -o requirements/run.txt pyproject.toml
	@$(COMPILE) --extra dev -c requirements/run.txt -o requirements/dev.txt pyproject.toml
	@$(COMPILE) --extra training -c requirements/dev.txt -o requirements/training.txt pyproject.toml
	@sed -i 's/^pyopengl==3.1.0$$/pyopengl==3.1.10/' requirements/run.txt requirements/dev.txt
	@grep '^spandrel==' requirements/training.txt > requirements/spandrel.txt
	@sed -i 's/^\(torch==[0-9.]*\)+.*/\1/; /^pyrender==/d; /^pyopengl==/d; /^spandrel==/d; /^torchvision==/d' \
		requirements/training.txt

clean:
	@rm -rf $(VENV) demo-out *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
