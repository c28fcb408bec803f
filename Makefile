# Every target first installs what it needs: system libraries, `.venv`, packages.
.DELETE_ON_ERROR:
.DEFAULT_GOAL := help
SHELL := /bin/bash

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
SYSTEM := $(VENV)/.system
PACKAGES := $(VENV)/.packages
INSTALLED := $(VENV)/.installed
TOOLS := $(VENV)/.tools
KERNELS := $(VENV)/.kernels
PIP := $(BIN)/pip install --quiet --no-compile --constraint constraints.txt \
	$(if $(TORCH),--extra-index-url https://download.pytorch.org/whl/$(TORCH))

# Python keeps the byte code of what it imports, and pip would compile the rest, too: 300 MB.
KEEPING := env -u PYTHONDONTWRITEBYTECODE

# Shared libraries that SUMO's wheels load from the system, and the Debian packages that hold them.
LIBRARIES := libGL.so.1 libX11.so.6 libXext.so.6 libXrender.so.1 libexpat.so.1 libatomic.so.1
DEBIAN := libgl1 libx11-6 libxext6 libxrender1 libexpat1 libatomic1

.PHONY: help install tools run traffic test test-fast types check format build-scenario pages docs pictures page lock wheel clean

help:  ## list the targets
	@awk -F':.*## ' '/^[a-z-]+:.*## /{printf "  make %-15s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

install: $(INSTALLED)  ## create .venv with what `make run` needs (TORCH=cpu: PyTorch without CUDA)

tools: $(TOOLS)  ## install what tests, checks and documents need

run: $(INSTALLED)  ## train PPO at the intersection, test it and write the report: two minutes on two idle cores
	$(KEEPING) $(BIN)/smarts-bench run configs/quickstart.yaml

traffic: $(INSTALLED)  ## build a scenario and run a minute of its traffic
	$(BIN)/smarts-bench scenario run intersection --seconds 60 --out results/traffic/intersection.png

test: $(KERNELS)  ## run all tests but the nightly ones
	$(BIN)/python -m pytest -q -n 2 --dist worksteal -m "not nightly"

test-fast: $(KERNELS)  ## run the tests of what starts neither Ray nor a simulation
	$(BIN)/python -m pytest -q -m "not nightly" tests/test_layers.py \
		tests/unit/test_{config_files,registry,same_episodes,whole_files,wrong_packages}.py \
		tests/unit/{core,dynamics,geometry,planners,roads,stream,types} \
		tests/unit/benchmark/test_{experiments,metrics,statistics}.py

types: $(KERNELS)  ## check the types
	$(BIN)/pyright --pythonpath $(BIN)/python

check: $(KERNELS)  ## format, lint, types and fast tests: two minutes on two idle cores
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(MAKE) --no-print-directory --jobs 2 --output-sync types test-fast

format: $(TOOLS)  ## format the code
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

build-scenario: $(INSTALLED)  ## build one scenario by hand: make build-scenario scenario=scenarios/loop
	@test -n "$(scenario)" || { echo "usage: make build-scenario scenario=DIRECTORY" >&2; exit 2; }
	$(BIN)/smarts-bench scenario build "$(scenario)"

pages: $(TOOLS)  ## write the API reference from the docstrings, and the examples into their pages
	$(BIN)/python -m docs.write_pages

docs: $(TOOLS)  ## build the documents: site/index.html, which needs no network
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet --clean

pictures: $(KERNELS)  ## draw the sheet of all scenarios, and the film and pictures of the README in Envision
	$(BIN)/smarts-bench scenario show --all --out docs/scenarios.png
	episodes=$$(mktemp -d) && trap 'rm -rf "$$episodes"' EXIT && \
	$(BIN)/smarts-bench evaluate --agent smarts.zoo:gap-acceptance-v0 --scenario intersection \
		--traffic random_social_vehicles --episodes 1 --out "$$episodes"/played && \
	$(BIN)/python -m tests.envision.screenshots docs "$$episodes"/played/episodes/*/seed42_world2000000_episode00000 && \
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

wheel: $(SYSTEM)  ## build a wheel with scenarios and configs, in dist/
	$(BIN)/pip wheel --quiet --no-deps --wheel-dir dist .

clean:  ## remove the virtual environment and built scenarios
	rm -rf $(VENV) scenarios/*/build

$(SYSTEM):
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(0 if (3, 11) <= v <= (3, 13) else f"Python 3.11 to 3.13 is needed, {sys.executable} is {v[0]}.{v[1]}: make PYTHON=python3.13 ...")'
	@missing=; for library in $(LIBRARIES); do ldconfig -p | grep -q "$$library" || missing=1; done; \
	if [ -n "$$missing" ]; then \
		sudo=; [ "$$(id -u)" = 0 ] || sudo=sudo; \
		{ $$sudo apt-get update -qq && $$sudo apt-get install -qq -y --no-install-recommends $(DEBIAN); } \
		|| { echo "SUMO needs $(LIBRARIES): install $(DEBIAN) and run make again" >&2; exit 2; }; \
	fi
	$(PYTHON) -m venv $(VENV)
	@touch $@

$(PACKAGES): pyproject.toml constraints.txt | $(SYSTEM)
	@echo "Installing 2.5 GB of packages in $(VENV): some minutes."
	@[ -n "$(TORCH)" ] || echo "PyPI's PyTorch brings 3 GB of CUDA; \`make install TORCH=cpu\` takes the one without."
	@$(BIN)/python -c 'import sys; sys.exit(sys.version_info < (3, 12))' && \
		echo "pybullet has no wheel for this Python: the C++ compiler builds it once, in 6 minutes." || true
	$(PIP) --editable '.[learn]'
	@# 0.7 GB: pybullet's robots and symbols for debuggers, libraries that several of SUMO's wheels bring.
	@cd $(VENV)/lib/python3.*/site-packages && rm -rf pybullet_{data,envs} && \
		{ strip -g pybullet.*.so; hardlink -q -c .; } 2>/dev/null || true
	@touch $@

$(INSTALLED): $(PACKAGES)
	$(KEEPING) $(BIN)/smarts-bench compile --experiments
	@touch $@

$(TOOLS): $(PACKAGES)
	@command -v chromium >/dev/null || { \
		sudo=; [ "$$(id -u)" = 0 ] || sudo=sudo; \
		{ $$sudo apt-get update -qq && $$sudo apt-get install -qq -y --no-install-recommends chromium; } \
		|| echo "tests in a browser (tests/envision) need chromium, which could not be installed" >&2; \
	}
	@echo "Installing 1 GB of packages for tests and documents in $(VENV): a minute or two."
	$(PIP) --editable '.[dev,docs,learn]'
	@# Tests start many processes, each of which would compile sources anew where PYTHONDONTWRITEBYTECODE is set.
	@$(BIN)/python -m compileall -qq -j 2 $(VENV)/lib algorithms benchmark perf smarts smarts_agent_kit 2>/dev/null || true
	@touch $@

$(KERNELS): $(TOOLS)
	$(BIN)/smarts-bench compile
	@touch $@

.PHONY: nightly
nightly: $(KERNELS)  ## run the nightly tests and what trains; the output is results/nightly.txt
	$(BIN)/python -m tests.nightly > results/nightly.txt
