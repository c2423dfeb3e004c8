"""The render engine: writes the scene, runs the program, shows its rounds, and reads its layers."""

import os
import shutil
import tempfile
import time
from contextlib import contextmanager

import bpy

from . import exr, export, nodes, passes, program
from .camera import SceneError
from .framing import border_pixels
from .notices import Notices
from .panels import ENGINE
from .settings import program_preference

#: Seconds between two looks at the program.
_PAUSE = 0.05


class _Cancelled(Exception):
    pass


class CardioidRenderEngine(bpy.types.RenderEngine):
    bl_idname = ENGINE
    bl_label = "cardioid"
    bl_use_preview = False
    bl_use_eevee_viewport = True
    bl_use_shading_nodes_custom = False

    def update_render_passes(self, scene=None, renderlayer=None):
        self.register_pass(scene, renderlayer, "Combined", 4, "RGBA", "COLOR")
        for name, channels, ids, kind in _passes_of(renderlayer):
            self.register_pass(scene, renderlayer, name, channels, ids, kind)

    def render(self, depsgraph):
        notices = Notices()
        try:
            with _folder(depsgraph.scene.cardioid.folder) as folder:
                self._render(depsgraph, folder, notices)
        except _Cancelled:
            pass
        except (SceneError, program.ProgramError, exr.ExrError, OSError) as error:
            self._fail(str(error))
        finally:
            for line in notices.lines():
                self.report({"WARNING"}, line)

    def _fail(self, text):
        self.report({"ERROR"}, text)

    def _render(self, depsgraph, folder, notices):
        start = time.monotonic()
        scene, settings = depsgraph.scene, depsgraph.scene.cardioid
        path = program.find(program_preference())
        render = scene.render
        size = tuple(max(int(side * render.resolution_percentage / 100), 1) for side in (render.resolution_x, render.resolution_y))
        border = (0, 0) + size
        if render.use_border:
            border = border_pixels(*size, render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y)
        if render.use_multiview:
            notices.add(f"scene '{scene.name}'", "several views are not modelled; all are that of the camera")
        self.update_stats("", "writing the scene")
        written = export.write(depsgraph, folder, size, border, notices)
        job = _Job(self, depsgraph, path, folder, written, (border[2] - border[0], border[3] - border[1]), notices)
        limit = settings.time_limit
        rounds = settings.rounds or program.ROUNDS[settings.quality]
        in_rounds = settings.integrator == "progressive"
        kept = os.path.join(folder, "rounds")
        if os.path.exists(kept):
            # Of another frame, in a folder that is kept.
            os.remove(kept)
        # Rounds that go on give the same picture as rounds that never stopped.
        for step in program.round_steps(rounds) if in_rounds else [0]:
            left = program.seconds_left(start, limit)
            words = program.options(
                settings.quality,
                settings.integrator,
                settings.seed,
                left,
                render.threads if render.threads_mode == "FIXED" else 0,
                settings.extra,
                step,
            )
            if in_rounds:
                words += ["--checkpoint", kept] + (["--resume", kept] if os.path.exists(kept) else [])
            picture = job.run(words, step, rounds)
            # Fewer rounds than asked for: there was no time for more, or a target error is reached.
            if in_rounds and passes.rounds(picture) < step:
                break


class _Job:
    """The runs of one frame."""

    def __init__(self, engine, depsgraph, path, folder, written, size, notices):
        self._engine, self._path, self._written, self._notices = engine, path, written, notices
        self._layer = depsgraph.view_layer.name
        self._picture = os.path.join(folder, "picture.exr")
        self._size = size
        self._share, self._step = 0.0, None

    def run(self, words, step, rounds):
        """Runs the program, shows its picture and yields it. `step`: rounds after which this run ends, of `rounds`; 0 without rounds."""
        engine, frame = self._engine, self._written.frame
        window = None if frame.is_whole else frame.window
        run = program.Run(program.command(self._path, self._written.scene, self._picture, words, window))
        try:
            while (code := run.poll()) is None:
                if engine.test_break():
                    raise _Cancelled
                self._tell(run, step, rounds)
                time.sleep(_PAUSE)
        finally:
            run.cancel()
        for kind, text in program.sorted_messages(run.messages, self._written.scene):
            if kind == "WARNING":
                self._notices.add("cardioid", text)
            else:
                engine.report({"INFO"}, f"cardioid: {text}")
        if code != 0:
            raise program.ProgramError(run.failure(code))
        picture = exr.read(self._picture)
        self._show(picture)
        return picture

    def _tell(self, run, step, rounds):
        """Shows what is done and the share of the frame, which never goes back. `step`: rounds after which this run ends, of `rounds`."""
        if run.step.startswith("rounds"):
            share = run.share * step / rounds
        elif run.step == "rendering":
            share = 0.3 + 0.7 * run.share
        else:
            # Steps before the pixels, each from its beginning.
            share = 0.0 if step else 0.3 * run.share
        if share > self._share:
            self._share = min(share, 1.0)
            self._engine.update_progress(self._share)
        if run.step != self._step:
            self._step = run.step
            self._engine.update_stats("", f"cardioid: {run.step}")

    def _show(self, picture):
        engine = self._engine
        result = engine.begin_result(0, 0, *self._size, layer=self._layer)
        if picture.size != self._size:
            engine.end_result(result, cancel=True)
            raise program.ProgramError(f"the picture has {picture.size} pixels, and {self._size} were asked for")
        values = {
            "Combined": lambda: passes.combined(picture),
            "Depth": lambda: passes.depth(picture, self._written.frame),
            "Normal": lambda: passes.normal(picture),
            "DiffCol": lambda: passes.layer(picture, "albedo"),
            "Diffuse Color": lambda: passes.layer(picture, "albedo"),
        }
        for own in result.layers[0].passes:
            layer = values[own.name]() if own.name in values else passes.layer(picture, own.name)
            if layer is not None:
                own.rect.foreach_set(passes.flat(layer))
        engine.end_result(result)


def _passes_of(view_layer):
    """Name, channels and kind of the passes beside the picture."""
    wanted = []
    if view_layer.use_pass_z:
        wanted.append(("Depth", 1, "Z", "VALUE"))
    if view_layer.use_pass_normal:
        wanted.append(("Normal", 3, "XYZ", "VECTOR"))
    if view_layer.use_pass_diffuse_color:
        wanted.append((_DIFFUSE_COLOUR, 3, "RGB", "COLOR"))
    return wanted + [(name, 3, "RGB", "COLOR") for name in passes.LIGHT]


#: Blender 5.0 writes the names of its passes out.
_DIFFUSE_COLOUR = "Diffuse Color" if bpy.app.version >= (5, 0, 0) else "DiffCol"


@contextmanager
def _folder(kept):
    """A folder for the files of a frame: the one that is to be kept, or a temporary one."""
    if kept:
        path = bpy.path.abspath(kept)
        os.makedirs(path, exist_ok=True)
        yield path
        return
    path = tempfile.mkdtemp(prefix="cardioid-")
    try:
        yield path
    finally:
        shutil.rmtree(path, ignore_errors=True)


nodes.ALWAYS = bpy.app.version >= (5, 0, 0)


def register():
    bpy.utils.register_class(CardioidRenderEngine)


def unregister():
    bpy.utils.unregister_class(CardioidRenderEngine)
