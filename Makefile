# Everything one does with the project. `make` alone lists it.
.DEFAULT_GOAL := help
PYTHON ?= python3
BIN := .venv/bin
export OPENBLAS_NUM_THREADS := 1
# Where the environment forbids bytecode beside the sources it is kept in .venv: a system starts eight processes, the
# tests some hundred, and without it each compiles numba, pydantic and ourselves anew (1.9 instead of 0.7 s a service).
ifdef PYTHONDONTWRITEBYTECODE
unexport PYTHONDONTWRITEBYTECODE
export PYTHONPYCACHEPREFIX := $(CURDIR)/.venv/bytecode
endif

.PHONY: help demo setup style lint check test test-all test-processors bench figures warm wheel site sbom lock clean

help: ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## /{printf "  make %-16s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

demo: ## set up, then walk the hexapod over rough terrain with every service live
	@PYTHON=$(PYTHON) scripts/setup core
	@$(BIN)/surefoot run rough-terrain

setup: ## virtual environment with everything tests need
	@PYTHON=$(PYTHON) scripts/setup dev

warm: setup ## compile the numeric kernels of all systems
	@$(BIN)/surefoot warm --all

style: setup ## style and layers
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports --no-cache > .lint-imports.log || { cat .lint-imports.log; exit 1; }

lint: style ## style, layers, types (types take two minutes)
	$(BIN)/pyright --pythonpath $(BIN)/python

check: style ## style, layers and the quick tests (< 1 min)
	$(BIN)/pytest -n 2 --dist loadfile tests/schemas tests/surefoot tests/contract -m "not slow and not e2e"

# By file: the tests of a file share the live system that its fixture starts. In the order of tests/conftest.py.
test: warm ## all tests but the long ones (about 20 min on two cores)
	$(BIN)/pytest -n 2 --dist loadfile --no-loadscope-reorder -m "not slow"

test-all: warm ## all tests
	$(BIN)/pytest

test-processors: warm ## numeric tests under other processor settings (3 min each)
	$(BIN)/python -m tests.processors

bench: warm ## the long studies and side-by-side timings
	$(BIN)/python -m benchmarks all

figures: warm ## figures of the pages beside what the short commands print (a minute)
	$(BIN)/python -m benchmarks report --check

wheel: warm ## the wheel with its compiled kernels in dist/ (x86-64 with AVX2)
	$(BIN)/python scripts/build_wheel.py dist

site: setup ## the pages as a site in site/ (needs pip install -e '.[docs]')
	@[ -x $(BIN)/mkdocs ] || { echo "make site needs mkdocs: $(BIN)/pip install -e '.[docs]'" >&2; exit 1; }
	$(BIN)/mkdocs build --strict

sbom: setup ## bill of materials of the pinned packages, as sbom.json (CycloneDX)
	$(BIN)/python scripts/sbom.py > sbom.json

lock: ## pin the newest allowed packages
	uv pip compile -q --universal --python-version 3.11 --generate-hashes --no-header --no-annotate pyproject.toml -o requirements.lock
	uv pip compile -q --universal --python-version 3.11 --generate-hashes --no-header --no-annotate --extra dev pyproject.toml -o requirements-dev.lock

clean: ## remove what the commands above made
	rm -rf .venv build dist site sbom.json *.egg-info .lint-imports.log
