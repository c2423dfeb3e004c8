# What there is to do with cardioid. Each target installs what it needs first; see setup.sh.

SCENE := scenes/cornell-spheres.toml
PICTURE := out/cornell-spheres.exr

.PHONY: demo test test-isa test-cluster readme bench peers results quality accuracy blender test-blender check fmt clippy doc setup

# Renders a scene, in a minute or so.
demo: setup
	cargo build --release
	mkdir -p $(dir $(PICTURE))
	cargo run --release --quiet -- render $(SCENE) --quality preview -o $(PICTURE)
	@echo "The picture: $(PICTURE), and for any viewer $(PICTURE:.exr=.png)"

# Without examples, which clippy compiles, and without documentation tests, of which there are none.
TESTS := --release --workspace --lib --bins --tests

test: setup
	CARDIOID_OPENVDB=required cargo test $(TESTS)

# All tests under each instruction set that this machine has, the best one last.
test-isa: setup
	@for isa in sse4.2 avx2 avx512; do \
	    needs=$$(echo $$isa | sed 's/avx512/avx512vl/; s/sse4.2/sse4_2/'); \
	    grep -qw "$$needs" /proc/cpuinfo || { echo "$$isa: this machine does not have it"; continue; }; \
	    echo "== $$isa"; \
	    CARDIOID_ISA=$$isa cargo test $(TESTS) || exit 1; \
	done

# Parts and a merge on a Slurm cluster of two nodes on this machine, where tasks and a node die. Needs root; skipped where Slurm cannot be installed.
test-cluster: setup
	cargo build --release
	tests/cluster/slurm.sh target/release/cardioid

# Every line of README.md that starts the program, at quick settings, in a copy of this folder.
readme: setup
	cargo build --release
	tests/readme.sh target/release/cardioid

# The add-on for Blender as an extension: "Install from Disk" takes it. docs/blender.md
blender:
	@mkdir -p out
	@python3 blender/pack.py out

# The add-on: its plain parts, and inside of Blender where there is one. Seconds without Blender, minutes with it.
test-blender:
	@tests/blender.sh target/release/cardioid

bench: setup
	cargo bench

# Our seconds and errors on the reference scenes, beside POV-Ray's where it is installed (apt install povray).
peers: setup
	cargo build --release
	benches/peers/run.sh

# All tables of docs/results.md, anew.
results: setup
	cargo build --release
	benches/results.sh >docs/results.md.new
	mv docs/results.md.new docs/results.md

# All tables of docs/quality.md, anew: presets against what nothing beats, and the price of each knob.
quality: setup
	cargo build --release
	benches/references.sh
	benches/quality.sh >docs/quality.md.new
	mv docs/quality.md.new docs/quality.md

# docs/accuracy.md: estimates against closed forms. Fails where one is off.
accuracy: setup
	cargo build --release
	target/release/cardioid validate -o docs/accuracy.md

check: fmt clippy doc

fmt:
	cargo fmt --all --check

# All in the release profile: clippy and doc share what they compile, and build scripts and macros are shared with test.
clippy: setup
	cargo clippy --release --workspace --all-targets -- -D warnings

doc: setup
	RUSTDOCFLAGS="-D warnings" cargo doc --release --workspace --no-deps

setup:
	@./setup.sh
