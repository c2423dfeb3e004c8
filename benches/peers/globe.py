#!/usr/bin/env python3
"""A large mesh in sun and sky, 1280 x 720, beside Mitsuba 3: time and memory against error.

    benches/peers/globe.py MESH.ply [--reference-spp 256] [--repeats 3] [--size 1280x720] > table.md

The scene is that of `cardioid render MESH.ply` (scenes/mesh.toml) with a box filter, and the same in Mitsuba, where it is installed
(`pip install mitsuba`; this script is run by the Python that has it). Wall and processor seconds and peak memory of whole processes,
reading and writing included; medians, in turns. Errors are free of the noise of the reference, which comes from `--integrator path` in
two halves: mean((t - r1)(t - r2) / (r^2 + 0.01)).
"""
import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
PROGRAM = os.path.join(os.environ.get("CARGO_TARGET_DIR", os.path.join(ROOT, "target")), "release", "cardioid")
OURS = [
    ("cardioid, draft", ["--quality", "draft"]),
    ("cardioid, preview", ["--quality", "preview"]),
    ("cardioid, path, 16 spp", ["--integrator", "path", "--spp", "16"]),
]
THEIRS = [4, 16, 64]


def bounds(path):
    """Bounding box of a binary little-endian PLY whose vertices begin with three floats."""
    import numpy

    with open(path, "rb") as file:
        head = file.read(65536)
        end = head.index(b"end_header\n") + 11
        text = head[:end].decode("latin-1")
        if "binary_little_endian" not in text:
            sys.exit("the mesh has to be binary little-endian PLY")
        count = int(re.search(r"element vertex (\d+)", text).group(1))
        properties = text[text.index("element vertex"):].split("element")[1].count("property")
        file.seek(end)
        values = numpy.fromfile(file, "<f4", count * properties).reshape(count, properties)[:, :3]
    return values.min(0).astype(float), values.max(0).astype(float)


def render_with_mitsuba(mesh, spp, size, out):
    """One picture, in a process of its own."""
    import mitsuba as mi

    # LLVM where it is there, which is faster; else C++ alone.
    try:
        mi.set_variant("llvm_ad_rgb")
        import drjit

        drjit.eval(mi.Float(1.0) + 1.0)
    except Exception:
        mi.set_variant("scalar_rgb")
    from mitsuba import ScalarTransform4f as T

    low, high = bounds(mesh)
    scale = float(1.0 / max(high - low))
    at = [float(v) for v in (-0.5 * scale * (low[0] + high[0]), -scale * low[1], -0.5 * scale * (low[2] + high[2]))]
    diffuse = lambda colour: {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": colour}}}
    scene = mi.load_dict({
        "type": "scene",
        "integrator": {"type": "path", "max_depth": -1},
        "sensor": {
            "type": "perspective",
            "fov": 38.0,
            "fov_axis": "y",
            "to_world": T().look_at(origin=[1.1, 1.0, 2.1], target=[0.0, 0.35, 0.0], up=[0, 1, 0]),
            "sampler": {"type": "independent", "sample_count": spp},
            "film": {
                "type": "hdrfilm",
                "width": size[0],
                "height": size[1],
                "rfilter": {"type": "box"},
                "pixel_format": "rgb",
                "component_format": "float32",
            },
        },
        "mesh": {
            "type": "ply",
            "filename": mesh,
            "face_normals": True,
            "to_world": T().translate(at).scale(scale),
            "bsdf": diffuse([0.7, 0.5, 0.4]),
        },
        "ground": {
            "type": "disk",
            "to_world": T().rotate([1, 0, 0], -90).scale(4.0),
            "bsdf": diffuse([0.45, 0.42, 0.38]),
        },
        "sun": {"type": "directional", "direction": [0.8, -1.0, -0.3], "irradiance": {"type": "rgb", "value": [3.0, 2.8, 2.5]}},
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.25, 0.32, 0.45]}},
    })
    mi.util.write_bitmap(out, mi.render(scene, spp=spp, seed=7), write_async=False)
    print(mi.variant(), mi.__version__)


def run(command):
    """Wall seconds, processor seconds and megabytes of one process, and what it printed."""
    start = time.monotonic()
    child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    out, err = child.stdout.read(), child.stderr.read()
    _, status, usage = os.wait4(child.pid, 0)
    if status != 0:
        sys.exit(f"{' '.join(command)} failed: {err}{out}")
    return time.monotonic() - start, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1000.0, out


def median(values):
    values = sorted(values)
    middle = len(values) // 2
    return values[middle] if len(values) % 2 else 0.5 * (values[middle - 1] + values[middle])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mesh")
    parser.add_argument("--reference-spp", type=int, default=256)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--size", default="1280x720")
    parser.add_argument("--mitsuba", nargs=2, metavar=("SPP", "OUT"), help=argparse.SUPPRESS)
    args = parser.parse_args()
    size = [int(side) for side in args.size.split("x")]
    if args.mitsuba:
        render_with_mitsuba(args.mesh, int(args.mitsuba[0]), size, args.mitsuba[1])
        return
    if not os.path.exists(PROGRAM):
        sys.exit("build first: cargo build --release")
    has_mitsuba = subprocess.run([sys.executable, "-c", "import mitsuba, numpy"], capture_output=True).returncode == 0
    if not has_mitsuba:
        print("skipped: this Python has no mitsuba (pip install mitsuba numpy); cardioid alone is measured", file=sys.stderr)
    with tempfile.TemporaryDirectory() as folder:
        with open(os.path.join(ROOT, "scenes/mesh.toml"), encoding="utf-8") as file:
            text = file.read().replace('filter = "gaussian"', 'filter = { type = "box", radius = 0.5 }')
        scene = os.path.join(folder, "globe.toml")
        with open(scene, "w", encoding="utf-8") as file:
            file.write(text)
        ours = [PROGRAM, "render", scene, "--set", f"mesh={os.path.abspath(args.mesh)}", "--resolution", args.size, "--quiet"]
        halves = []
        for seed in ("101", "102"):
            halves.append(os.path.join(folder, f"reference-{seed}.exr"))
            run(ours + ["--integrator", "path", "--spp", str(args.reference_spp), "--seed", seed, "--beauty-only", "-o", halves[-1]])
            print(f"reference {seed} done", file=sys.stderr)
        rows = [(name, ours + options) for name, options in OURS]
        if has_mitsuba:
            rows += [(f"Mitsuba, path, {spp} spp", spp) for spp in THEIRS]
        measured = {name: [] for name, _ in rows}
        errors, variant = {}, ""
        for _ in range(args.repeats):
            for name, what in rows:
                out = os.path.join(folder, "picture.exr")
                if isinstance(what, int):
                    command = [sys.executable, os.path.abspath(__file__), args.mesh, "--size", args.size, "--mitsuba", str(what), out]
                else:
                    command = what + ["-o", out]
                *figures, said = run(command)
                variant = said.strip() if isinstance(what, int) else variant
                measured[name].append(figures)
                if name not in errors:
                    compare = [PROGRAM, "compare", halves[0], "--second-half", halves[1], out, "--json"]
                    errors[name] = json.loads(run(compare)[3])[0]
        print(f"{os.path.basename(args.mesh)}, {args.size}, medians of {args.repeats} runs in turns, load {os.getloadavg()[0]:.1f}")
        if variant:
            print(f"Mitsuba: {variant}")
        print("\n| renderer | wall s | processor s | MB | error | bias |\n|---|--:|--:|--:|--:|--:|")
        for name, _ in rows:
            wall, cpu, memory = (median([figures[i] for figures in measured[name]]) for i in range(3))
            error = errors[name]
            print(f"| {name} | {wall:.1f} | {cpu:.1f} | {memory:.0f} | {error['relmse_u']:.5f} | {error['bias']:+.2f} % |")


main()
