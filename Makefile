# Every target prepares what it needs in .venv; `make` alone lists them.
#
#   make PYTHON=python3.12 setup       another interpreter, in a fresh checkout or after `make clean`
#   make test ARGS='-k angles'         further arguments for the command behind a target

PYTHON ?= python3
ARGS ?=

VENV := .venv
BIN := $(VENV)/bin
UNFINISHED := $(VENV)/.unfinished
RUN := $(VENV)/.installed-run
DEV := $(VENV)/.installed-dev

.DEFAULT_GOAL := help
.NOTPARALLEL:
.PHONY: help setup demo test lint bench docs notebooks audit clean

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "  make %-9s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

setup: $(DEV) ## install passloc with everything needed to develop it

demo: $(RUN) ## watch an agent localise an emitter
	$(BIN)/passloc demo $(ARGS)

test: export OMP_NUM_THREADS := 1
test: $(DEV) ## run the tests
	$(BIN)/python -m pytest -n 2 $(ARGS)

lint: $(DEV) ## check style, format and types
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy

bench: $(DEV) ## measure the speed, beside FilterPy and Stone Soup
	$(BIN)/passloc bench $(ARGS)

docs: export NO_MKDOCS_2_WARNING := 1
docs: $(DEV) ## build the documentation into site/
	$(BIN)/mkdocs build --strict $(ARGS)

notebooks: export OMP_NUM_THREADS := 1
notebooks: $(DEV) ## execute the notebooks of the documentation again
	$(BIN)/python docs/hooks/execute_notebooks.py docs/notebooks/*.ipynb

audit: $(DEV) ## compare pinned versions with stored advisories: make audit ARGS=folder-of-OSV-files
	$(BIN)/python .ci/audit.py constraints.txt $(ARGS)

clean: ## remove .venv, caches and build results (runs/ stays)
	rm -rf $(VENV) build dist site .hypothesis .mypy_cache .pytest_cache .ruff_cache
	find passloc_env agents training tests benchmarks -name __pycache__ -prune -exec rm -rf {} +

# An install that was cut short may leave half-written packages which pip takes for whole ones, so the mark
# .unfinished stands for as long as an install runs, and finding it means to start again from nothing.
define install
	@$(PYTHON) -c 'import sys; sys.version_info < (3, 11) and \
		sys.exit("passloc needs Python 3.11 or newer; name one like this: make PYTHON=python3.11")'
	@if test -e $(UNFINISHED); then echo 'The last set-up did not finish: starting afresh.'; rm -rf $(VENV); fi
	@mkdir -p $(VENV) && touch $(UNFINISHED) && rm -f $(RUN) $(DEV)
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --disable-pip-version-check -c constraints.txt -e '.[$(EXTRAS)]'
	@rm $(UNFINISHED) && touch $(STAMPS)
endef

$(RUN): EXTRAS := train,render
$(RUN): STAMPS := $(RUN)
$(RUN): pyproject.toml constraints.txt
	$(install)

$(DEV): EXTRAS := train,render,dev,docs
$(DEV): STAMPS := $(RUN) $(DEV)
$(DEV): pyproject.toml constraints.txt
	$(install)
