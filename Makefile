# `make demo` shows what the program does, `make test` checks all of it, `make soak` compares 10,000 random tiles on
# each device with their neighbours and parents, and lets every single call of OpenCL fail once.
VENV := .venv
PYTHON := $(VENV)/bin/python
OUT := out
.PHONY: demo test soak clean

demo: $(VENV)/demo.stamp
	@$(VENV)/bin/sketchterrain generate valley_river -o $(OUT)/valley_river

test: $(VENV)/test.stamp
	$(PYTHON) -m ruff check .
	$(PYTHON) -m ruff format --check .
	@bash .ci/typecheck
	$(PYTHON) -m pytest -n auto --dist worksteal

soak: $(VENV)/test.stamp
	SOAK_TILES=10000 SKETCHTERRAIN_SOAK=1 $(PYTHON) -m pytest -n auto tests/terrain/test_random_tiles.py \
		tests/terrain/test_device_verdict.py tests/cli/test_device_failures.py tests/ui/test_kills.py

$(VENV)/demo.stamp: pyproject.toml .ci/setup
	@bash .ci/setup $(VENV) cpu
	@touch $@

$(VENV)/test.stamp: pyproject.toml .ci/setup
	@bash .ci/setup $(VENV) cpu,dev
	@touch $@ $(VENV)/demo.stamp

# Stores the frozen results anew: docs/testing.md says when that is allowed.
.PHONY: freeze
freeze: $(VENV)/test.stamp
	$(PYTHON) tests/frozen/frozen_results.py --write

clean:
	rm -rf $(VENV) $(OUT) build dist *.egg-info
