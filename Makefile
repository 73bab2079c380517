# `make demo` shows what the program does, `make test` checks all of it, `make soak` compares 10,000 random tiles on
# each device with their neighbours and parents.
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
	$(PYTHON) -m pytest -n auto

soak: $(VENV)/test.stamp
	SOAK_TILES=10000 $(PYTHON) -m pytest tests/terrain/test_random_tiles.py -n auto

$(VENV)/demo.stamp: pyproject.toml .ci/setup
	@bash .ci/setup $(VENV) cpu
	@touch $@

$(VENV)/test.stamp: pyproject.toml .ci/setup
	@bash .ci/setup $(VENV) cpu,dev
	@touch $@ $(VENV)/demo.stamp

clean:
	rm -rf $(VENV) $(OUT) build dist *.egg-info
