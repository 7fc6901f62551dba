# `make` lists the targets. Those that run something first install what they need into .venv, from requirements.lock.
PYTHON ?= python3
OUT ?= results/puma560-adaptive
ARMS ?= 500
BIN := .venv/bin
STAMP := .venv/installed
PIP := $(BIN)/python -m pip --disable-pip-version-check
DOCS := docs/_build/html

# The locked packages and this one, into another environment: its version is asked for wherever a result is written.
define installed-into
$(1)/bin/pip install --quiet --require-hashes --no-deps --only-binary :all: -r requirements.lock
$(1)/bin/pip install --quiet --no-deps --no-build-isolation -e .
endef

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: architecture help demo test test-nightly search golden bench gallery sdist figures check-stability check-export check-page check-pages check-examples check-data check-learners check-neighbours check-robots check-drive mutants lint types docs format contest licences audit lock clean

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "make %-15s %s\n", $$1, $$2}' Makefile

demo: $(STAMP) ## run the adaptive PUMA 560 experiment, into results/puma560-adaptive (or OUT=...)
	$(BIN)/adaptctl experiment run puma560-adaptive --out $(OUT) --overwrite
	@echo '(rerun is $(BIN)/rerun)'

test: $(STAMP) ## run the tests, and the examples of README.md and docs/
	$(BIN)/python -m pytest -n 2 --dist worksteal

test-nightly: $(STAMP) ## run the long tests, of which `make test` has a selection
	ADAPTCTL_OPTIMIZATION=1 $(BIN)/python -m pytest -n 2 --dist worksteal -m nightly

search: $(STAMP) ## run the property-based tests with fresh random seeds
	$(BIN)/python -m pytest -n 2 --dist worksteal --hypothesis-profile=search -m '' $$(grep -l '^from hypothesis import' tests/test_*.py)

golden: $(STAMP) ## compare outputs with the references in tests/golden; ten minutes (PARTS="robots exports" for some; UPDATE=1 to update them)
	$(BIN)/python tests/golden/capture.py $(PARTS) $(if $(UPDATE),--update)

bench: $(STAMP) ## measure the speed against other tools, and update docs/speed.md and README.md's plot; three minutes
	$(BIN)/python -m benchmarks

contest: $(STAMP) ## rank all laws on benchmarks/contest.toml, into results/contest and docs/contest.md; a quarter of an hour, resumes where it was stopped
	$(BIN)/adaptctl contest benchmarks/contest.toml --out results/contest --measure-step-time
	$(BIN)/adaptctl contest benchmarks/laws_judged_on.toml --out results/laws
	$(BIN)/python -m docs.making.contest results/contest results/laws

figures: $(STAMP) ## check the documented bounds, into results/figures.json, and update docs/verification.md
	@rm -rf results/.figures && mkdir -p results/.figures
	ADAPTCTL_FIGURES=$(CURDIR)/results/.figures $(BIN)/python -m pytest -q -m '' $$(grep -l '^from figures import' tests/test_*.py)
	$(BIN)/python tests/figures.py results/.figures results/figures.json
	$(BIN)/python -m docs.making.verification results/figures.json

check-stability: $(STAMP) ## simulate 10,000 closed loops of ten minutes on random arms; hours (ARMS=50 for fewer)
	$(BIN)/python -m benchmarks.stability --arms $(ARMS)

check-export: $(STAMP) ## compare the exported C of every law, with every installed compiler, bit for bit; half an hour (LAWS="puma loop" for some; PUBLISH=--publish updates docs/export.md)
	PYTHONPATH=.:tests $(BIN)/python tests/check_export.py $(LAWS) $(PUBLISH)

check-page: $(STAMP) ## test exported WebAssembly in node, and a report's simulation in a browser, if installed
	PYTHONPATH=.:tests $(BIN)/python tests/check_page.py

check-pages: docs ## check documentation and reports in a headless browser: accessibility (axe-core), widths, valid HTML; npm in build/pages
	PYTHONPATH=. $(BIN)/python tests/check_pages.py $(DOCS) results

check-examples: $(STAMP) ## run all commands and examples of README and docs from empty folders, with an installed wheel; ten minutes (PAGES="quickstart cli" for some)
	$(BIN)/python tests/check_examples.py $(PAGES)

mutants: $(STAMP) ## mutation tests of the whole package; three hours (MUTANTS="--folders control" for some)
	nice -n 12 $(BIN)/python tests/mutants.py $(MUTANTS)

check-drive: $(STAMP) ## stop, interrupt and disturb driven arms 1,400 times; half an hour (SHARE=0.1 for fewer)
	PYTHONPATH=.:tests $(BIN)/python tests/check_drive.py $(SHARE)

check-robots: $(STAMP) ## run the Franka example and a WidowX through the vendors' own clients, against three simulators; five minutes (RUNS="20 4 20 1" for more)
	test -x .venv-vendors/bin/python || $(PYTHON) -m venv .venv-vendors
	test -x .venv-vendors-limits/bin/python || $(PYTHON) -m venv .venv-vendors-limits
	.venv-vendors/bin/pip install --quiet franky-sim==1.0.4 trossen-arm-sim==0.2.3 trossen-arm==1.11.0 || true
	.venv-vendors/bin/pip install --quiet --no-deps --upgrade --target .venv-vendors/client pylibfranka==0.21.3 franka-sim==1.1.7 trossen-arm==1.11.0 || true
	.venv-vendors-limits/bin/pip install --quiet franka-sim==1.1.7 || true
	$(BIN)/python tests/check_robots.py $(RUNS)

check-neighbours: ## check bases against figaroh's and Drake's own regressors, runs against Drake's, and in mujoco.sysid, in .venv-neighbours; ten minutes
	test -x .venv-neighbours/bin/python || $(PYTHON) -m venv .venv-neighbours
	$(call installed-into,.venv-neighbours)
	.venv-neighbours/bin/pip install --quiet figaroh drake 'mujoco[sysid]' || true
	PYTHONPATH=. .venv-neighbours/bin/python tests/check_neighbours.py
	PYTHONPATH=. .venv-neighbours/bin/python tests/check_sysid.py

check-data: ## try runs in DuckDB, rerun's catalog, LeRobot, Minari and moviepy, in .venv-data and .venv-lerobot; five minutes
	test -x .venv-data/bin/python || $(PYTHON) -m venv .venv-data
	$(call installed-into,.venv-data)
	.venv-data/bin/pip install --quiet duckdb moviepy 'minari[create]' 'rerun-sdk[catalog]' || true
	test -x .venv-lerobot/bin/python || $(PYTHON) -m venv .venv-lerobot
	.venv-lerobot/bin/pip install --quiet lerobot || true
	PYTHONPATH=.:tests .venv-data/bin/python tests/check_data.py

check-learners: ## run the documented recipes for PPO, SAC and residual learning, in .venv-learn; 20 minutes (RECIPES="ppo sac" for some)
	test -x .venv-learn/bin/python || $(PYTHON) -m venv .venv-learn
	.venv-learn/bin/python -c 'import torch, stable_baselines3' 2> /dev/null || .venv-learn/bin/pip install --quiet torch stable-baselines3 || true
	$(call installed-into,.venv-learn)
	PYTHONPATH=. .venv-learn/bin/python tests/check_learners.py $(RECIPES)

lint: $(STAMP) ## check the code style
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(STAMP) ## check the types
	$(BIN)/mypy

docs: $(STAMP) ## build the documentation, into docs/_build/html/index.html
	$(BIN)/sphinx-build -W --keep-going -q -b html docs $(DOCS)

architecture: $(STAMP) ## draw the import graph, into docs/images/architecture.svg
	$(BIN)/python docs/extensions/architecture.py

gallery: $(STAMP) ## update the gallery in docs/ from runs in results/gallery; ten minutes
	$(BIN)/python -m docs.making

sdist: $(STAMP) ## build the source distribution, and run its tests from it
	$(BIN)/python -m build --no-isolation --sdist
	rm -rf build/unpacked && mkdir -p build/unpacked && tar -xzf dist/adaptctl-*.tar.gz -C build/unpacked --strip-components=1
	cd build/unpacked && PYTHONPATH=$$PWD ADAPTCTL_OPTIMIZATION=1 $(CURDIR)/$(BIN)/python -m pytest -n 2 --dist worksteal tests

format: $(STAMP) ## format the code
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

licences: $(STAMP) ## list the licences of the locked packages, those with conditions or unknown ones first
	$(BIN)/python tests/licences.py

audit: ## check the locked packages for known vulnerabilities
	test -x .venv-lock/bin/pip-audit || ($(PYTHON) -m venv .venv-lock && .venv-lock/bin/pip install --quiet pip-audit)
	.venv-lock/bin/pip-audit --require-hashes --disable-pip -r requirements.lock

lock: ## update the locked dependencies in requirements.lock
	test -x .venv-lock/bin/uv || ($(PYTHON) -m venv --clear .venv-lock && .venv-lock/bin/pip install --quiet uv)
	.venv-lock/bin/uv pip compile pyproject.toml --group dev --universal --python-version 3.11 --generate-hashes \
		--no-emit-index-url --no-emit-find-links --no-header --quiet -o requirements.lock

clean: ## remove installed and built files; results/ is kept
	rm -rf .venv .venv-* build dist *.egg-info docs/_build

# Asked first: with a Python that is too old, pip would only say that it finds no matching distribution.
$(STAMP): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(v < (3, 11) and \
		"adaptctl needs Python 3.11 or newer; $(PYTHON) is %d.%d. Name another: make PYTHON=python3.12 ..." % v)'
	@$(PIP) --version > /dev/null 2>&1 || $(PYTHON) -m venv --clear .venv
	$(PIP) install --no-compile --require-hashes --no-deps --only-binary :all: -r requirements.lock
	$(PIP) install --no-compile --no-deps --no-build-isolation -e .
	@touch $@
