# `make demo` shows what the program does, `make test` checks it in minutes. `make test-slow` adds benchmarks, golden
# pictures and repeated runs; `make soak` compares 10,000 random tiles on each device with their neighbours and parents
# and lets every single call of OpenCL fail once. `make gpu` runs tests and benchmarks on a machine with a GPU.
# `make upgrade` renews the versions that the development environment is set up with.
VENV := .venv
PYTHON := $(VENV)/bin/python
PYTEST := $(PYTHON) -m pytest -n auto --dist worksteal
OUT := out
.PHONY: demo test test-slow soak gpu upgrade clean

demo: $(VENV)/demo.stamp
	@$(VENV)/bin/sketchterrain generate valley_river -o $(OUT)/valley_river

# The type check runs beside the tests; its report comes last.
test: $(VENV)/test.stamp
	$(PYTHON) -m ruff check .
	$(PYTHON) -m ruff format --check .
	@mkdir -p build; bash .ci/typecheck >build/types.log 2>&1 & types=$$!; \
		$(PYTEST); tests=$$?; \
		wait $$types; types=$$?; cat build/types.log; exit $$((tests + types > 0))

test-slow: $(VENV)/test.stamp
	$(PYTEST) -m slow

soak: $(VENV)/test.stamp
	$(PYTEST) -m soak -o faulthandler_timeout=0

gpu: $(VENV)/test.stamp
	@bash .ci/gpu

upgrade:
	@bash .ci/upgrade

$(VENV)/demo.stamp: pyproject.toml .ci/setup .ci/constraints.txt
	@bash .ci/setup $(VENV) cpu
	@touch $@

$(VENV)/test.stamp: pyproject.toml .ci/setup .ci/constraints.txt
	@bash .ci/setup $(VENV) cpu,dev
	@touch $@ $(VENV)/demo.stamp

# Stores the frozen results anew: docs/testing.md says when that is allowed.
.PHONY: freeze
freeze: $(VENV)/test.stamp
	$(PYTHON) tests/frozen/frozen_results.py --write

clean:
	rm -rf $(VENV) $(OUT) build dist *.egg-info
