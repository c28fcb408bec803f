# Every target first installs what it needs: system libraries, `.venv`, packages.
.DELETE_ON_ERROR:
.DEFAULT_GOAL := help
SHELL := /bin/bash

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
PACKAGES := $(VENV)/.packages
SYSTEM := $(VENV)/.system

# Shared libraries that SUMO's wheels load from the system, and the Debian packages that hold them.
LIBRARIES := libGL.so.1 libX11.so.6 libXext.so.6 libXrender.so.1 libexpat.so.1 libatomic.so.1
DEBIAN := libgl1 libx11-6 libxext6 libxrender1 libexpat1 libatomic1

.PHONY: help install packages run traffic test test-fast check format build-scenario pages docs pictures page lock clean

help:  ## list the targets
	@awk -F':.*## ' '/^[a-z-]+:.*## /{printf "  make %-15s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

install: $(INSTALLED)  ## create .venv, install everything and compile the kernels

packages: $(PACKAGES)  ## create .venv and install everything, without compiling the kernels

run: $(INSTALLED)  ## train PPO at the intersection, test it and write the report: three minutes on two idle cores
	$(BIN)/smarts-bench run configs/quickstart.yaml

traffic: $(INSTALLED)  ## build a scenario and run a minute of its traffic
	$(BIN)/smarts-bench scenario run intersection --seconds 60 --out results/traffic/intersection.png

test: $(INSTALLED)  ## run all tests but the nightly ones
	$(BIN)/python -m pytest -q -n 2 --dist worksteal -m "not nightly"

test-fast: $(INSTALLED)  ## run the tests that take seconds
	$(BIN)/python -m pytest -q -n 2 --dist worksteal -m "not slow and not nightly"

check: $(INSTALLED)  ## format, lint, types and fast tests
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/pyright --pythonpath $(BIN)/python
	$(MAKE) --no-print-directory test-fast

format: $(INSTALLED)  ## format the code
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

build-scenario: $(INSTALLED)  ## build one scenario by hand: make build-scenario scenario=scenarios/loop
	@test -n "$(scenario)" || { echo "usage: make build-scenario scenario=DIRECTORY" >&2; exit 2; }
	$(BIN)/smarts-bench scenario build "$(scenario)"

pages: $(INSTALLED)  ## write the API reference from the docstrings, and the examples into their pages
	$(BIN)/python -m docs.write_pages

docs: $(INSTALLED)  ## build the documents: site/index.html, which needs no network
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet --clean

pictures: $(INSTALLED)  ## draw the sheet of all scenarios, and the film and pictures of the README in Envision
	$(BIN)/smarts-bench scenario show --all --out docs/scenarios.png
	episodes=$$(mktemp -d) && trap 'rm -rf "$$episodes"' EXIT && \
	$(BIN)/smarts-bench scripted gap_acceptance --scenario intersection --episodes 1 --record "$$episodes" && \
	$(BIN)/smarts-bench view "$$episodes"/gap_acceptance/intersection/seed42_world2000000_episode00000~2 \
		--out "$$episodes"/driving.smarts && \
	$(BIN)/python -m tests.envision.screenshots docs "$$episodes"/driving.smarts && \
	$(BIN)/python examples/bubbles.py "$$episodes"/bubbles && \
	$(BIN)/smarts-bench render "$$episodes"/bubbles/seed42_world0_episode00000 --at 10 \
		--out docs/bubble.png --width 800

page:  ## build the page that shows episodes, smarts/envision/viewer.html, from its sources (needs Node 20)
	cd smarts/envision/page && npm ci --no-audit --no-fund && npm run build
	cp smarts/envision/page/dist/index.html smarts/envision/viewer.html

lock: ## write the exact versions of a fresh installation to constraints.txt
	rm -rf .venv-lock && $(PYTHON) -m venv .venv-lock
	.venv-lock/bin/pip install --quiet torch==2.13.0 -e '.[dev,docs,learn]'
	.venv-lock/bin/pip freeze --exclude-editable | sed 's/+cpu$$//' > constraints.txt
	rm -rf .venv-lock

clean:  ## remove the virtual environment and built scenarios
	rm -rf $(VENV) scenarios/*/build

$(SYSTEM):
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(0 if v == (3, 11) else f"Python 3.11 is needed, {sys.executable} is {v[0]}.{v[1]}: make PYTHON=python3.11 ...")'
	@missing=; for library in $(LIBRARIES); do ldconfig -p | grep -q "$$library" || missing=1; done; \
	if [ -n "$$missing" ]; then \
		sudo=; [ "$$(id -u)" = 0 ] || sudo=sudo; \
		{ $$sudo apt-get update -qq && $$sudo apt-get install -qq -y --no-install-recommends $(DEBIAN); } \
		|| { echo "SUMO needs $(LIBRARIES): install $(DEBIAN) and run make again" >&2; exit 2; }; \
	fi
	@command -v chromium >/dev/null || { \
		sudo=; [ "$$(id -u)" = 0 ] || sudo=sudo; \
		{ $$sudo apt-get update -qq && $$sudo apt-get install -qq -y --no-install-recommends chromium; } \
		|| echo "tests in a browser (tests/envision) need chromium, which could not be installed" >&2; \
	}
	$(PYTHON) -m venv $(VENV)
	@touch $@

# Where PYTHONDONTWRITEBYTECODE is set, every process would compile these sources anew.
$(PACKAGES): pyproject.toml constraints.txt | $(SYSTEM)
	$(BIN)/pip install --quiet --constraint constraints.txt --editable '.[dev,docs,learn]'
	$(BIN)/python -m compileall -q -j 2 algorithms benchmark perf smarts smarts_agent_kit
	@touch $@

$(INSTALLED): $(PACKAGES)
	$(BIN)/smarts-bench compile
	@touch $@

.PHONY: nightly
nightly: $(INSTALLED)  ## run the nightly tests and what trains; the output is results/nightly.txt
	$(BIN)/python -m tests.nightly > results/nightly.txt
