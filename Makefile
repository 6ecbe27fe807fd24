# Everything that a newcomer needs: `make demo` and `make test`. Both set up `.venv`
# first; uv is used if it is there, else Python's own venv and pip.

PYTHON ?= python3
BIN := .venv/bin
DEMO := doosan_a0912 --motion tutorial --record out/demo.html --plot out/demo.png \
	--log out/demo.npz

# What `make setup` downloads of requirements.lock, on Linux.
DOWNLOAD := about 650 MB

.PHONY: demo test quick fuzz lint docs bench setup lock clean

setup: .venv/.ready

.venv/.ready: pyproject.toml requirements.lock
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
		|| { echo "arm_drake needs Python 3.11 or newer: make PYTHON=python3.x" >&2; exit 1; }
	@echo "setting up .venv, once: Drake and what it needs, $(DOWNLOAD) to download; this takes minutes"
	@rm -f $@; start=$$(date +%s); \
	step() { echo "$$(($$(date +%s) - start)) s: $$1"; }; \
	install() { $(BIN)/pip install -r requirements.lock \
		&& $(BIN)/pip install --quiet --no-deps -e . && touch $@; }; \
	if command -v uv >/dev/null; then \
		step "uv creates the environment, downloads and installs"; \
		uv sync --locked --python $(PYTHON) && touch $@; \
	else \
		$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null \
			|| { echo "this Python has no venv; on Debian: apt install python3-venv" >&2; exit 1; }; \
		step "creating the environment"; \
		$(PYTHON) -m venv .venv || exit 1; \
		step "downloading with pip; the largest are"; \
		if [ -t 1 ]; then install; else install | sed -un \
			-e 's/^ *Downloading \(.* ([0-9]\{2,\}\.[0-9] MB)\)$$/  \1/p' \
			-e 's/^Installing collected.*/  all is there; installing it/p'; fi; \
	fi; \
	test -e $@ && step "done"

# The tutorial's goal on the bundled Doosan A0912, in the browser, at real time.
demo: setup
	@mkdir -p out
	$(BIN)/arm-drake sim $(DEMO) $(ARGS)

# Else every worker, and every process that a test starts, compiles all modules anew.
test quick: export PYTHONDONTWRITEBYTECODE :=

# Each process has a part of the files, so that what a file's tests share is made once,
# and takes of the other's when it is done.
SHARED := -n auto --dist worksteal

test: setup
	$(BIN)/python -m pytest $(SHARED) $(ARGS)

# What a developer runs every few minutes.
quick: setup
	$(BIN)/python -m pytest $(SHARED) -m "not slow and not browser" $(ARGS)

# Mutated inputs, each in a process with limits: SECONDS=3600 for an hour of them.
SECONDS ?= 60
fuzz: setup
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.fuzz --seconds $(SECONDS) $(ARGS)

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# README, pages, notebooks with their results and the API reference, in
# out/docs/index.html. A warning is an error.
docs: setup
	rm -rf out/docs
	$(BIN)/python -m sphinx -q -W --keep-going -c docs . out/docs

# Its extra is what we are compared with; it stays installed.
bench: setup
	@if command -v uv >/dev/null; then \
		uv sync --quiet --locked --inexact --extra bench --python $(PYTHON); \
	else \
		$(BIN)/pip install --quiet -c requirements.lock -e '.[bench]'; \
	fi
	$(BIN)/python -m tests.benchmarks.overhead $(ARGS)
	$(BIN)/python -m tests.benchmarks.instructions
	$(BIN)/python -m tests.benchmarks.loading
	$(BIN)/python -m tests.benchmarks.page
	$(BIN)/python -m tests.benchmarks.many --rounds 3 --output out
	$(BIN)/python -m tests.benchmarks.peers --output out --page
	$(BIN)/python -m pytest -m long
	$(BIN)/python -m pytest --both-ways tests/simulation
	$(BIN)/python -m tests.benchmarks.ticks
	$(BIN)/python -m tests.benchmarks.servo
	$(BIN)/python -m tests.benchmarks.inverse_kinematics
	$(BIN)/python -m tests.benchmarks.planning
	$(BIN)/python -m tests.benchmarks.environments
	$(BIN)/python -m tests.benchmarks.wire

# For those who change the dependencies; needs uv.
lock:
	uv lock
	uv export --quiet --locked --no-hashes --no-emit-project --no-header \
		--no-annotate -o requirements.lock

clean:
	rm -rf .venv out
