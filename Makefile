# Two commands on a machine with Python 3.11 and make: `make demo` and `make test`. Both set up .venv themselves.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
BIN := .venv/bin
READY := .venv/ready

.PHONY: demo test lint bench bench-calibration bench-sync bench-runtime bench-streams constraints sicsg-env train-env clean

demo: $(READY)
	$(BIN)/python -m tools.demo out/demo

test: $(READY)
	$(BIN)/python -m pytest -n 2 --dist loadfile

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: $(READY)
	$(BIN)/python tools/bench/run.py

# Calibration beside its peers, one thread each; resumes from out/bench-calibration.jsonl (its longer runs: --help).
bench-calibration: $(READY)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python tools/bench/calibration.py

# Clocks: estimator, probes, video, the check before a recording; with PARTS="estimator board" only those.
bench-sync: $(READY)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python tools/bench/sync.py $(PARTS)

# Detections to tracks: time of a frame set, its growth, and what the tracks are worth in crowds; PARTS as above.
bench-runtime: $(READY)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python tools/bench/runtime.py $(PARTS)

# The live runtime on four 1080p30 streams for ten minutes; with ARGS="--source rtsp --minutes 1" from a server, and so on.
bench-streams: $(READY)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tools.bench.streams --minutes 10 $(ARGS)

# Exactly the pinned versions, each checked against its hash; then the project itself, from this folder.
$(READY): constraints.txt pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes --requirement constraints.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-build-isolation --no-deps --editable .
	touch $(READY)

# Renews the pins after a change of pyproject.toml (needs uv).
constraints:
	uv pip compile pyproject.toml --extra dev --universal --python-version 3.11 --generate-hashes --upgrade \
		--no-emit-index-url --no-emit-find-links --no-annotate --no-header --output-file constraints.txt

# Blender as a module, for the path tracer of tools/sicsg; it needs an older NumPy, so an environment of its own.
sicsg-env: .venv-sicsg/ready
.venv-sicsg/ready: tools/sicsg/blender/constraints.txt
	$(PYTHON) -m venv .venv-sicsg
	.venv-sicsg/bin/python -m pip install --quiet --disable-pip-version-check --require-hashes --requirement $<
	touch $@

# PyTorch (build for CPUs) and ONNX beside the project, for tools/train.
train-env: .venv-train/ready
.venv-train/ready: tools/train/constraints.txt constraints.txt
	$(PYTHON) -m venv .venv-train
	.venv-train/bin/python -m pip install --quiet --disable-pip-version-check --require-hashes \
		--requirement constraints.txt --requirement tools/train/constraints.txt
	.venv-train/bin/python -m pip install --quiet --disable-pip-version-check --no-build-isolation --no-deps --editable .
	touch $@

clean:
	rm -rf .venv .venv-sicsg .venv-train out .cache dist
