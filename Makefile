# `make demo` shows what the program does, `make test` tests it in minutes. `make check` runs linter and type check,
# `make test-slow` benchmarks, golden pictures and repeated runs; `make soak` compares 10,000 random tiles on each device
# with their neighbours and parents and lets every single call of OpenCL fail once. `make gpu` runs tests and benchmarks
# on a machine with a GPU. `make wheels` builds wheels of all platforms into dist. `make upgrade` renews the versions
# that the development environment is set up with.
VENV := .venv
PYTHON := $(VENV)/bin/python
PYTEST := $(PYTHON) -m pytest -n auto
OUT := out
# Containers often forbid Python to keep compiled modules, which then cost each process seconds.
unexport PYTHONDONTWRITEBYTECODE
.PHONY: demo check test test-slow soak gpu wheels upgrade clean

demo: $(VENV)/demo.stamp
	@$(VENV)/bin/sketchterrain generate valley_river -o $(OUT)/valley_river

check: $(VENV)/test.stamp
	$(PYTHON) -m ruff check .
	$(PYTHON) -m ruff format --check .
	@bash .ci/typecheck

test: $(VENV)/test.stamp
	$(PYTEST)

test-slow: $(VENV)/test.stamp
	$(PYTEST) -m slow

soak: $(VENV)/test.stamp
	$(PYTEST) -m soak -o faulthandler_timeout=0

gpu: $(VENV)/test.stamp
	@bash .ci/gpu

# One for each platform, whatever this one is; zig compiles the loops of kernels/host.
wheels: $(VENV)/demo.stamp
	@for platform in manylinux_2_17_x86_64 manylinux_2_17_aarch64 win_amd64 macosx_11_0_arm64 macosx_11_0_x86_64; do \
		$(PYTHON) -m pip wheel --quiet --no-deps --wheel-dir dist --config-settings platform=$$platform . || exit; \
	done

upgrade:
	@bash .ci/upgrade

$(VENV)/demo.stamp: pyproject.toml .ci/setup .ci/constraints.txt
	@bash .ci/setup $(VENV) cpu
	@touch $@

$(VENV)/test.stamp: pyproject.toml .ci/setup .ci/constraints.txt
	@bash .ci/setup $(VENV) cpu,dev
	@$(PYTHON) tests/warm_up.py
	@touch $@ $(VENV)/demo.stamp

# Stores the frozen results anew: docs/testing.md says when that is allowed.
.PHONY: freeze
freeze: $(VENV)/test.stamp
	$(PYTHON) tests/frozen/frozen_results.py --write

clean:
	rm -rf $(VENV) $(OUT) build dist *.egg-info
