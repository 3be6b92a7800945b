# Two commands matter: `make demo` (set up, then the main job on the embedded sample) and `make test` (what CI runs).
VENV ?= .venv
PYTHON ?= python3.11
TORCH ?= torch==2.13.0
BIN := $(VENV)/bin

.PHONY: demo test check unit wheel interpreters docs test-gpu readers test-readers test-tfds test-lerobot test-llm test-ray clean
.DEFAULT_GOAL := test

# The path file is for a Python that starts in the folder that holds the clone: it would take that for the package.
$(VENV)/.installed: pyproject.toml
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV) || python3 -m venv $(VENV)
	@echo "installing torch and what rpaug needs into $(VENV): some minutes, once"
	$(BIN)/python -m pip install --quiet --disable-pip-version-check "$(TORCH)"
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[dev]"
	$(BIN)/python -c "import site; print(site.getsitepackages()[0])" | xargs -I % sh -c 'echo "$(CURDIR)" > "%/rpaug_clone.pth"'
	touch $@

demo: $(VENV)/.installed
	rm -rf demo-output demo-output-preview.html
	$(BIN)/rpaug demo --out demo-output

test: check unit wheel

check: $(VENV)/.installed
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# Compiled modules are kept, whatever the shell says: each worker reads every test file, and hundreds of processes start.
unit: $(VENV)/.installed
	OMP_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest -n 2 --dist loadfile

wheel: $(VENV)/.installed
	$(BIN)/python tools/check_wheel.py

# Uses the wheel under the other Pythons that are meant and found; says which are not.
interpreters: $(VENV)/.installed
	TORCH="$(TORCH)" $(BIN)/python tools/check_interpreters.py

# The documents' site, with search: python -m http.server --directory build/site
docs: $(VENV)/.installed
	$(BIN)/python -m tools.docs.site

test-gpu: $(VENV)/.installed
	$(BIN)/python -m pytest -m gpu

test-llm: $(VENV)/.installed
	RPAUG_LLM=$$($(BIN)/python tools/fetch_llm.py) $(BIN)/python -m pytest -s tests/language/test_llm.py

# Makes other people's readers from their pins, and runs all tests with them.
readers: $(VENV)/.installed
	test -n "$(RPAUG_READERS)" && test -n "$(RPAUG_TEST_DATA)"
	tools/readers.sh
	$(MAKE) test-readers

# RPAUG_READERS and RPAUG_TEST_DATA say where the readers and the recordings are (docs/readers.md).
test-readers: $(VENV)/.installed
	test -n "$(RPAUG_READERS)" && test -n "$(RPAUG_TEST_DATA)"
	$(BIN)/python -m pytest tests/readers

test-tfds: $(VENV)/.installed
	$(BIN)/python -m pytest tests/readers/test_tfds_reader.py

test-lerobot: $(VENV)/.installed
	$(BIN)/python -m pytest tests/readers/test_lerobot_reader.py tests/readers/test_lerobot_v21_readers.py

test-ray: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[cluster]" "ray[default]"
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest tests/pipeline/test_cluster.py

clean:
	rm -rf $(VENV) build dist demo-output demo-output-preview.html *.egg-info .pytest_cache .mypy_cache .ruff_cache .import_linter_cache
