# make demo and make test set up everything they need; the others do too.
BIN := .venv/bin
TYPED := .typing/slopegate/core .typing/slopegate/drivers .typing/slopegate/app .typing/slopegate/resources
# A virtual screen with OpenGL drawn in software.
SCREEN := env -u WAYLAND_DISPLAY QT_QPA_PLATFORM=xcb LIBGL_ALWAYS_SOFTWARE=1 xvfb-run -a -s "-screen 0 1920x1200x24"
# Tests that share the screen, the pointer and the keys run one after the other, all others two at a time.
WINDOWS := $(addprefix tests/app/,devices panels views widgets window)

.PHONY: demo check test test-slow test-calibration bench bench-check bench-live pictures clean help

help:
	@echo "make demo       open the window; without a display, tour it on a virtual one and keep pictures in demo-output"
	@echo "make check      style, types and import contracts"
	@echo "make test       style, types, import contracts and tests"
	@echo "make test-slow  every test, the long ones too, and many more random cases"
	@echo "make test-calibration  200 hidden rigs: numbers within their standard errors, planned gates where they were wanted"
	@echo "make bench      run time against error of every way to make a frame, on shipped scenes and real captures"
	@echo "make bench-check  what got slower or less accurate than the committed baseline"
	@echo "make bench-live   speed of the live path, as ratios within one run"
	@echo "make pictures   the README's pictures anew; run make bench before it for that of the bench"
	@echo "make clean      remove whatever make made, .venv too"

demo:
	@if [ -n "$$DISPLAY$$WAYLAND_DISPLAY" ] || [ "$$(uname)" = Darwin ]; then \
		.ci/setup && $(BIN)/slopegate; \
	else \
		.ci/setup --screen && echo "No display here: touring the window on a virtual one." && \
		$(SCREEN) $(BIN)/slopegate demo --out demo-output; \
	fi

check:
	@.ci/setup --tests
	@echo "== style (ruff)"
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@echo "== types (mypy --strict)"
	@$(BIN)/mypy --strict $(TYPED)
	@echo "== import contracts (import-linter)"
	@$(BIN)/lint-imports --no-logo

test: check
	@echo "== tests of all but the window (pytest, two at a time)"
	@$(SCREEN) $(BIN)/pytest -m "not slow" --numprocesses 2 --dist loadfile $(addprefix --ignore=,tests/benchmarks $(WINDOWS))
	@echo "== tests of the window (pytest, on a virtual screen)"
	@$(SCREEN) $(BIN)/pytest -m "not slow" $(WINDOWS)

test-slow:
	@.ci/setup --tests
	@$(SCREEN) $(BIN)/pytest --ignore=tests/benchmarks --hypothesis-profile=thorough --timeout=3000

test-calibration:
	@.ci/setup --tests
	@$(BIN)/pytest -m slow -s --timeout=14400 tests/drivers/calibrations/test_hidden_truth.py

# Real captures beside the checkout, where there are any.
CAPTURES := $(wildcard $(addprefix ../shared/data/scenes/,five_people motorcycle tum_fr2_desk))

bench:
	@.ci/setup
	@$(BIN)/slopegate bench --scene shipped $(CAPTURES) --out bench-output

bench-check:
	@.ci/setup
	@$(BIN)/slopegate bench --check resources/bench/baseline.json

bench-live:
	@.ci/setup --screen
	@$(SCREEN) $(BIN)/pytest tests/benchmarks

pictures:
	@.ci/setup --screen
	@$(SCREEN) $(BIN)/python -P .ci/pictures

clean:
	rm -rf .venv .mypy_cache .ruff_cache .pytest_cache .hypothesis .benchmarks .import_linter_cache
	rm -rf build dist demo-output bench-output *.egg-info
	find app core drivers resources tests -name __pycache__ -type d -prune -exec rm -rf {} +
