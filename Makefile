# Needs Python 3.12 or later, git and make. `make demo` is the place to start.
# PYTHON=/path/to/python chooses the interpreter; ARGS="..." is passed on to pytest, the demo and the bench.

VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.ready
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
# installs the package with some extras and groups; pip checks the files of other packages by their hashes, its own
# and those of the build among them
INSTALL = $(BIN)/python .ci/requirements.py $(1) >$(VENV)/requirements.txt && \
	$(PIP) -c constraints.txt -r $(VENV)/requirements.txt && $(PIP) --no-deps --no-build-isolation --editable .

.PHONY: help demo test check fuzz docs lock links paper real bench clean
help:
	@echo "make demo    set up, then from a robot with a hidden fault to its name"
	@echo "make test    set up, then format, lint, types and tests"
	@echo "make check   the same without the tests"
	@echo "make fuzz    10,000 spoilt inputs; INPUTS=n for another number"
	@echo "make docs    the documentation, in site/"
	@echo "make lock    constraints.txt with hashes, and docs/licences.md"
	@echo "make links   addresses outside that code and documentation point to"
	@echo "make paper   the paper's figures, tables and claims beside ours, in paper/"
	@echo "make real    docs/real.md from the recordings of real machines in DATA=folder"
	@echo "make bench   how fast this machine simulates"
	@echo "make clean   remove all that was made, $(VENV) included"

$(STAMP): pyproject.toml constraints.txt
	@python=$$(sh .ci/find-python $(PYTHON)) || exit 1; \
	echo "Setting up $(VENV) with $$($$python --version); the first time this takes a few minutes ..."; \
	test -x $(BIN)/python && $(BIN)/python -c 'import sys; sys.exit(sys.version_info < (3, 12))' || $$python -m venv --clear $(VENV)
	@$(BIN)/python .ci/requirements.py --pinned build >$(VENV)/build.txt && \
	$(PIP) --require-hashes -r $(VENV)/build.txt
	@{ $(call INSTALL,all dev); } 2>$(VENV)/pip.log || { cat $(VENV)/pip.log; exit 1; }
	@$(BIN)/exodrake warm-up
	@touch $(STAMP)

demo: $(STAMP)
	$(BIN)/exodrake demo $(ARGS)

check: $(STAMP)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/pyright

test: check
	@$(BIN)/exodrake warm-up # once here, not once in each worker
	$(BIN)/pytest -n 2 --dist worksteal $(ARGS)

fuzz: $(STAMP)
	@$(BIN)/exodrake warm-up
	FUZZ=$(or $(INPUTS),10000) $(BIN)/pytest tests/test_fuzz.py tests/test_fuzz_recordings.py $(ARGS)

docs: $(STAMP)
	@$(call INSTALL,all docs)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

lock: $(STAMP)
	$(BIN)/python .ci/lock.py

links:
	@grep -rhoE 'https?://[^)>" ]+' README.md CONTRIBUTING.md docs exodrake --include='*.md' --include='*.py' | sort -u

paper: $(STAMP)
	$(BIN)/python -m studies.paper $(ARGS)

real: $(STAMP)
	$(BIN)/python -m studies.real_machines --data $(or $(DATA),../shared/data/real) --out docs $(ARGS)

bench: $(STAMP)
	@$(call INSTALL,bench)
	$(BIN)/python -m benchmarks $(ARGS)

clean:
	rm -rf $(VENV) build dist site *.egg-info .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
