# Each target sets up what it needs in .venv, without root. PYTHON names the interpreter (3.11 or newer).
PYTHON ?= python3
PORT ?= 8000
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --use-pep517

.PHONY: help demo test test-slow lint format coverage serve lock clean setup-training

help:
	@echo "make demo      three scenes: elemental image array, views before and after, a contact sheet, in demo-out/"
	@echo "make test      the tests; those for training are skipped until make setup-training has installed torch"
	@echo "make test-slow the slow tests: fuzzing, servers under kills and load, most of the page in a browser"
	@echo "make lint      ruff and mypy, strict (installs torch, to check training too)"
	@echo "make format    ruff, with the fixes that it can apply itself"
	@echo "make coverage  the tests, and the lines that they run"
	@echo "make serve     the HTTP service on http://127.0.0.1:8000 (or PORT=...), documented at /docs"
	@echo "make lock      new versions of all packages in requirements/"
	@echo "make clean     removes .venv and what the other targets wrote"

$(VENV)/.venv:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "$(PYTHON) is older than 3.11: name a newer one, as in make PYTHON=python3.11"; exit 1; }
	@echo "== creating $(VENV) with $$($(PYTHON) --version)"
	@$(PYTHON) -m venv $(VENV)
	@touch $@

# The locks list everything that packages require, except what is never imported: hence --no-deps.
$(VENV)/.%: requirements/%.txt pyproject.toml $(VENV)/.venv
	@echo "== installing $<"
	@$(PIP) --no-deps -r $<
	@$(PIP) --no-deps --editable .
	@touch $@

# torch requires different packages on each machine, which pip finds. spandrel requires torchvision, which nothing here
# imports and which fits only one build of torch.
$(VENV)/.training: requirements/training.txt requirements/spandrel.txt $(VENV)/.dev
	@echo "== installing $< (torch is large)"
	@$(PIP) --no-warn-conflicts -r $<
	@$(PIP) --no-deps -r requirements/spandrel.txt
	@touch $@

setup-training: $(VENV)/.training

demo: $(VENV)/.core
	@echo "== reconstructing three scenes into demo-out/"
	@$(BIN)/ciir demo -o demo-out

test: $(VENV)/.dev
	@echo "== running the tests"
	@$(BIN)/python -m pytest -n 4 --dist worksteal

test-slow: $(VENV)/.dev
	@echo "== running the slow tests"
	@$(BIN)/python -m pytest -n 4 --dist worksteal --slow -m slow

coverage: $(VENV)/.dev
	@$(BIN)/coverage erase
	@$(BIN)/coverage run -m pytest --slow
	@$(BIN)/coverage combine --quiet
	@$(BIN)/coverage report

lint: $(VENV)/.training
	@echo "== ruff"
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@echo "== mypy"
	@$(BIN)/mypy

format: $(VENV)/.dev
	@$(BIN)/ruff check --fix .
	@$(BIN)/ruff format .

serve: $(VENV)/.service
	@$(BIN)/ciir serve --port $(PORT)

# Exact versions, for the oldest supported Python. --unsafe-package leaves out what pyrender requires only for its
# window. pyrender also requires PyOpenGL 3.1.0, which fails on Python 3.12 and newer; 3.1.10 works on all.
COMPILE := $(BIN)/pip-compile --quiet --strip-extras --no-header --no-annotate --no-emit-index-url --no-emit-find-links \
	--no-emit-trusted-host --unsafe-package pyglet
WINDOW := --unsafe-package imageio
lock: $(VENV)/.dev
	@$(COMPILE) --extra basisu,batch,bench,dev,redis,s3,service,telemetry -o requirements/dev.txt pyproject.toml
	@$(COMPILE) $(WINDOW) -c requirements/dev.txt -o requirements/core.txt pyproject.toml
	@$(COMPILE) $(WINDOW) --extra batch,redis,s3,service -c requirements/dev.txt -o requirements/service.txt pyproject.toml
	@$(COMPILE) --extra training -c requirements/dev.txt -o requirements/training.txt pyproject.toml
	@grep '^spandrel==' requirements/training.txt > requirements/spandrel.txt
	@sed -i 's/^\(torch==[0-9.]*\)+.*/\1/; /^pyrender==/d; /^pyopengl==/d; /^spandrel==/d; /^torchvision==/d' \
		requirements/training.txt
	@sed -i 's/^pyopengl==3.1.0$$/pyopengl==3.1.10/; /^$$/d; /^#/d' requirements/*.txt

clean:
	@rm -rf $(VENV) demo-out build *.egg-info .coverage* .pytest_cache .mypy_cache .ruff_cache .hypothesis
