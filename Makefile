# `make` lists the targets. Those that run something first install what they need into .venv, from requirements.lock.
PYTHON ?= python3
OUT ?= results/puma560-adaptive
ARMS ?= 500
BIN := .venv/bin
STAMP := .venv/installed
PIP := $(BIN)/python -m pip --disable-pip-version-check
DOCS := docs/_build/html

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: architecture help demo test test-nightly search golden bench gallery sdist figures check-stability check-export check-page check-pages check-learners mutants lint types docs format licences audit lock clean

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "make %-15s %s\n", $$1, $$2}' Makefile

demo: $(STAMP) ## an adaptive PUMA 560, from energies to a recording, in results/puma560-adaptive (or OUT=...)
	$(BIN)/adaptctl experiment run puma560-adaptive --out $(OUT) --overwrite
	@echo '(rerun is $(BIN)/rerun)'

test: $(STAMP) ## the tests, and every example of README.md and docs/
	$(BIN)/python -m pytest -n 2 --dist worksteal

test-nightly: $(STAMP) ## those tests that take long, and that `make test` has some of
	$(BIN)/python -m pytest -n 2 --dist worksteal -m nightly

search: $(STAMP) ## the tests that draw their cases, on cases drawn anew each time
	$(BIN)/python -m pytest -n 2 --dist worksteal --hypothesis-profile=search -m '' $$(grep -l '^from hypothesis import' tests/test_*.py)

golden: $(STAMP) ## what is kept in tests/golden against what is so now; ten minutes (PARTS="robots exports"; UPDATE=1 to keep it)
	$(BIN)/python tests/golden/capture.py $(PARTS) $(if $(UPDATE),--update)

bench: $(STAMP) ## speed against its peers, in three minutes; docs/speed.md and README.md's plot then show it
	$(BIN)/python -m benchmarks

figures: $(STAMP) ## bounds that the project promises and the figures found today, in results/figures.json; docs/verification.md then shows them
	@rm -rf results/.figures && mkdir -p results/.figures
	ADAPTCTL_FIGURES=$(CURDIR)/results/.figures $(BIN)/python -m pytest -q -m '' $$(grep -l '^from figures import' tests/test_*.py)
	$(BIN)/python tests/figures.py results/.figures results/figures.json
	$(BIN)/python -m docs.making.verification results/figures.json

check-stability: $(STAMP) ## 10,000 closed loops of ten minutes on random arms; hours (ARMS=50 for some of them)
	$(BIN)/python -m benchmarks.stability --arms $(ARMS)

check-export: $(STAMP) ## exported C of every law, by every compiler that is here, bit for bit; half an hour (LAWS="puma loop"; PUBLISH=--publish for docs/export.md)
	PYTHONPATH=.:tests $(BIN)/python tests/check_export.py $(LAWS) $(PUBLISH)

check-page: $(STAMP) ## exported WebAssembly in node, and a report's arm in a browser, if they are here
	PYTHONPATH=.:tests $(BIN)/python tests/check_page.py

check-pages: docs ## documentation and reports in a browser without a window: axe-core, widths, valid HTML, by npm in build/pages
	PYTHONPATH=. $(BIN)/python tests/check_pages.py $(DOCS) results

mutants: $(STAMP) ## small changes of identifiability, dynamics and control that tests ought to notice; an hour
	nice -n 12 $(BIN)/python tests/mutants.py $(MUTANTS)

check-learners: ## PPO, SAC and residual learning by the documented recipes, in .venv-learn; 20 minutes (RECIPES="ppo sac")
	test -x .venv-learn/bin/python || $(PYTHON) -m venv .venv-learn
	.venv-learn/bin/python -c 'import torch, stable_baselines3' 2> /dev/null || .venv-learn/bin/pip install --quiet torch stable-baselines3 || true
	.venv-learn/bin/pip install --quiet --require-hashes --no-deps --only-binary :all: -r requirements.lock
	PYTHONPATH=. .venv-learn/bin/python tests/check_learners.py $(RECIPES)

lint: $(STAMP) ## style of the code
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(STAMP) ## types of the code
	$(BIN)/mypy

docs: $(STAMP) ## the documentation, in docs/_build/html/index.html
	$(BIN)/sphinx-build -W --keep-going -q -b html docs $(DOCS)

architecture: $(STAMP) ## the picture of what imports what, in docs/images/architecture.svg
	$(BIN)/python docs/extensions/architecture.py

gallery: $(STAMP) ## the animation and the page of all experiments in docs/, from runs in results/gallery; ten minutes
	$(BIN)/python -m docs.making

sdist: $(STAMP) ## the source distribution, and its own tests run from it
	$(BIN)/python -m build --no-isolation --sdist
	rm -rf build/unpacked && mkdir -p build/unpacked && tar -xzf dist/adaptctl-*.tar.gz -C build/unpacked --strip-components=1
	cd build/unpacked && PYTHONPATH=$$PWD $(CURDIR)/$(BIN)/python -m pytest -n 2 --dist worksteal tests

format: $(STAMP) ## bring the code into style
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

licences: $(STAMP) ## licences of all that is locked, those first that ask for something or are not known
	$(BIN)/python tests/licences.py

audit: ## known vulnerabilities of all that is locked
	test -x .venv-lock/bin/pip-audit || ($(PYTHON) -m venv .venv-lock && .venv-lock/bin/pip install --quiet pip-audit)
	.venv-lock/bin/pip-audit --require-hashes --disable-pip -r requirements.lock

lock: ## resolve the dependencies anew into requirements.lock
	test -x .venv-lock/bin/uv || ($(PYTHON) -m venv --clear .venv-lock && .venv-lock/bin/pip install --quiet uv)
	.venv-lock/bin/uv pip compile pyproject.toml --group dev --universal --python-version 3.11 --generate-hashes \
		--no-emit-index-url --no-emit-find-links --no-header --quiet -o requirements.lock

clean: ## remove what was installed and built; results/ stays
	rm -rf .venv .venv-lock .venv-learn build dist *.egg-info docs/_build

# Asked first: with a Python that is too old, pip would only say that it finds no matching distribution.
$(STAMP): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(v < (3, 11) and \
		"adaptctl needs Python 3.11 or newer; $(PYTHON) is %d.%d. Name another: make PYTHON=python3.12 ..." % v)'
	@$(PIP) --version > /dev/null 2>&1 || $(PYTHON) -m venv --clear .venv
	$(PIP) install --quiet --require-hashes --no-deps --only-binary :all: -r requirements.lock
	$(PIP) install --quiet --no-deps --no-build-isolation -e .
	@touch $@
