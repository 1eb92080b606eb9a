"""The render engine: exports a frame, has it rendered, and shows the picture as it becomes right.

Blender calls render() in a thread of its own and waits for it. So nothing here waits longer than farm.TICK_S without a look at
Blender's Esc, and the export runs in a second Blender (export.py), which may change its copy of the scene at will."""
import atexit
import json
import os
import shutil
import tempfile
import time
import traceback

import bpy

from . import exr, farm, options, passes

LOOK_S = 0.7            # between two questions about a job
EXPORT_LIMIT_S = 3600.0
END_PATIENCE_S = 60.0   # after Esc: for the job's own picture


class Stopped(Exception):
    """Esc."""


class Session:
    """What a render, or all frames of an animation, share: the copy of the scene, the exporter, the local farm."""

    def __init__(self):
        self.folder = tempfile.mkdtemp(prefix="azulejo-blender-")
        self.exporter = self.pipe = self.local = None
        self.count = 0

    def new_folder(self):
        self.count += 1
        path = os.path.join(self.folder, "frame-%d" % self.count)
        os.mkdir(path)
        return path

    def start_exporter(self, scene, camera):
        copy = os.path.join(self.folder, "scene.blend")
        bpy.data.libraries.write(copy, {scene}, path_remap="ABSOLUTE", fake_user=False, compress=False)
        script = os.path.join(os.path.dirname(os.path.abspath(__file__)), "export.py")
        words = [bpy.app.binary_path, "-b", "-t", "1", "--factory-startup"]
        words += ["--enable-autoexec"] if bpy.context.preferences.filepaths.use_scripts_auto_execute else []
        words += ["--python", script, "--", copy, scene.name, camera]
        self.exporter = farm.Exporter(words, self.folder)

    def export(self, scene, camera, request, tick):
        if self.exporter is None or self.exporter.ended():
            self.start_exporter(scene, camera)
        return self.exporter.ask(request, os.path.join(request["folder"], "answer.json"), tick, EXPORT_LIMIT_S)

    def local_farm(self, program, threads, tick):
        if self.local and not self.local.alive():
            self.local.stop()
            self.local = None
        if self.local is None:
            self.local = farm.Local(program, threads, self.folder, tick)
        return self.local

    def end(self):
        for part in (self.exporter, self.local):
            if part:
                part.stop()
        shutil.rmtree(self.folder, ignore_errors=True)


class Current:
    """The session in work, and what the last export could not hold, for the panel."""
    session = None
    notes = []


def end_session(*_):
    if Current.session:
        Current.session.end()
        Current.session = None


def wanted_passes(scene, layer):
    return passes.wanted(lambda flag: scene.azulejo.denoise != "OFF" if flag == passes.DENOISED else getattr(layer, flag, False),
                         getattr(layer, "pass_cryptomatte_depth", 6))


class Frame:
    """One call of render()."""

    def __init__(self, engine, depsgraph):
        self.engine = engine
        self.scene = depsgraph.scene
        self.panel = self.scene.azulejo
        self.layer = depsgraph.view_layer
        self.size = (engine.resolution_x, engine.resolution_y)
        render = self.scene.render
        self.border = options.border_pixels(self.size, render.border_min_x, render.border_min_y, render.border_max_x,
                                            render.border_max_y) if render.use_border else None
        cycles = getattr(self.scene, "cycles", None)
        self.gain = getattr(cycles, "film_exposure", 1.0)
        self.filter = options.pixel_filter(cycles.pixel_filter_type, cycles.filter_width) if cycles else None
        self.wanted = wanted_passes(self.scene, self.layer)
        self.result = None
        self.stopped = False
        self.shown = ""
        self.fields = []

    # ---- what is asked for ---------------------------------------------------------------------------------------------

    def settings(self):
        render, panel = self.scene.render, self.panel
        shutter = min(render.motion_blur_shutter, 1.0) if render.use_motion_blur else 0.0
        if shutter > 0 and self.scene.frame_current < 1:
            self.note("motion blur is exported from frame 1 on")
            shutter = 0.0
        name = os.path.splitext(os.path.basename(bpy.data.filepath))[0] or "untitled"
        return {"samples": panel.samples, "target_error": panel.target_error.strip(), "time_limit_s": panel.time_limit,
                "max_depth": panel.max_depth, "seed": panel.seed, "frame": self.scene.frame_current, "shutter": shutter,
                "transparent": render.film_transparent, "aovs": passes.aovs(self.wanted), "denoise": panel.denoise.lower(),
                "priority": panel.priority, "filter": self.filter, "name": "%s-%04d" % (name, self.scene.frame_current)}

    def position(self):
        render = self.scene.render
        return getattr(render, "motion_blur_position", None) or getattr(
            getattr(self.scene, "cycles", None), "motion_blur_position", "CENTER")

    # ---- Blender ---------------------------------------------------------------------------------------------------------

    def tick(self):
        if not self.stopped and self.engine.test_break():
            raise Stopped()

    def status(self, text):
        if text != self.shown:
            self.shown = text
            self.engine.update_stats("", "Azulejo | " + text)

    def note(self, text):
        if text not in Current.notes:
            Current.notes.append(text)
            self.engine.report({"WARNING"}, text)

    def begin(self):
        width, height = self.border[2:] if self.border else self.size
        self.result = self.engine.begin_result(0, 0, width, height, layer=self.layer.name)
        if self.result is None or not self.result.layers:
            self.result = None
            raise Stopped()  # Blender has already given up
        layer = self.result.layers[0]
        for wanted in self.wanted:
            if wanted.name not in layer.passes:
                self.engine.add_pass(wanted.name, len(wanted.letters), wanted.letters, layer=layer.name)

    def show(self, path, whole):
        """Copy a file into the picture; `whole`: it has all layers."""
        picture = exr.read(path)
        width, height = self.border[2:] if self.border else self.size
        if (picture.width, picture.height) != (width, height):
            raise exr.BadFile("the picture has %dx%d pixels instead of %dx%d" % (picture.width, picture.height, width, height))
        layer = self.result.layers[0]
        passes.expose(picture, self.gain)
        self.fill(layer.passes["Combined"], passes.combined(picture))
        for wanted in self.wanted if whole else ():
            try:
                values = wanted.make(picture)
            except (TypeError, KeyError):
                values = None
            if values is None:
                self.note("pass %s: the picture has no %s" % (wanted.name, wanted.aov or "channels R, G and B"))
            elif wanted.name in layer.passes:
                self.fill(layer.passes[wanted.name], values)
        if whole:
            self.fields = passes.crypto_fields(picture, layer.name)
            if self.panel.denoise != "OFF" and not passes.is_denoised(picture):
                self.note("the picture is not denoised: the coordinator's log says why")
        self.engine.update_result(self.result)

    def stamp(self):
        """What Blender writes into the headers of files."""
        whole = self.engine.get_result() if self.fields else None
        for field, text in self.fields if whole else ():
            whole.stamp_data_add_field(field, text)

    @staticmethod
    def fill(target, values):
        flat = passes.blender_rows(values)
        try:
            target.rect.foreach_set(flat)
        except TypeError:  # before Blender 4: it takes rect for an array of one dimension
            target.rect = flat.reshape(-1, target.channels)

    # ---- the work ----------------------------------------------------------------------------------------------------------

    def render(self):
        settings = self.settings()
        wrong = options.wrong(settings)
        if wrong:
            raise farm.Trouble(wrong)
        program = farm.find_program(bpy.path.abspath(self.panel.program) if self.panel.program else "")
        session = Current.session = Current.session or Session()
        folder = session.new_folder()
        self.begin()
        try:
            exported = self.export(session, folder, settings)
            job = self.start(session, program, folder, settings, exported)
            self.follow(session, job, folder)
        finally:
            self.engine.end_result(self.result)
            self.stamp()
            shutil.rmtree(folder, ignore_errors=True)

    def export(self, session, folder, settings):
        self.status("exports the scene")
        camera = self.engine.camera_override.name if self.engine.camera_override else ""
        exported = session.export(self.scene.original, camera, {
            "frame": self.scene.frame_current, "folder": folder, "size": list(self.size), "shutter": settings["shutter"],
            "position": self.position(), "layer": self.layer.name}, self.tick)
        if "error" in exported:
            raise farm.Trouble(exported["error"])
        for text in exported["notes"]:
            self.note(text)
        render = self.scene.render
        if render.use_motion_blur and render.motion_blur_shutter > 1:
            self.note("the shutter is open for one frame at most: %g became 1" % render.motion_blur_shutter)
        if render.pixel_aspect_x != render.pixel_aspect_y:
            self.note("the pixels' aspect is not exported: they are square")
        if self.filter and self.filter[1] > options.FILTER_WIDTH_MOST:
            self.note("the pixel filter is %g pixels wide at most, not %g" % (options.FILTER_WIDTH_MOST, self.filter[1]))
        crypto = [p for p in self.wanted if p.flag.startswith("use_pass_cryptomatte")]
        if crypto and self.layer.pass_cryptomatte_depth > 2 * passes.CRYPTO_LAYERS:
            self.note("Cryptomatte has %d levels at most" % (2 * passes.CRYPTO_LAYERS))
        if render.use_multiview:
            self.note("stereo views are not exported")
        return exported

    def start(self, session, program, folder, settings, exported):
        panel = self.panel
        if panel.device == "LOCAL":
            self.status("starts a coordinator and a worker")
            local = session.local_farm(program, panel.threads, self.tick)
            address, key = local.address, local.key
        else:
            address, key = panel.address.strip(), bpy.path.abspath(panel.key_file.strip()) if panel.key_file else ""
        job = farm.Job(program, address, key, folder, self.tick)
        self.status("sends the scene")
        job.submit(options.submit_words(settings, exported, self.size, self.border))
        for text in job.warnings:
            self.note("scene: " + text)
        return job

    def follow(self, session, job, folder):
        try:
            self.watch(session, job, folder)
        except Stopped:
            self.stopped = True  # from now on Esc is known
            self.keep(job, folder)
        except Exception:
            self.abandon(job)
            raise

    def watch(self, session, job, folder):
        preview, samples, silent_since = os.path.join(folder, "preview.exr"), 0, None
        while True:
            try:
                info = job.info()
                silent_since = None
                share, line = options.progress(info)
                self.engine.update_progress(share)
                self.status(line)
                if info["state"] in ("failed", "cancelled"):
                    raise farm.Trouble("the job %s: %s" % (info["state"], info["state_text"] or "the coordinator's log says why"))
                if info["state"] == "done":
                    return self.take(job, folder)
                # Each look at the picture is for twice the samples, so it costs little.
                if info["preview_covered"] > 0 and info["samples_done"] > 2 * samples and job.preview(preview):
                    samples = info["samples_done"]
                    self.show(preview, whole=False)
            except farm.Gone as gone:
                if session.local:
                    session.local.check()
                silent_since = silent_since or time.monotonic()
                if time.monotonic() - silent_since > self.panel.patience:
                    raise farm.Trouble("the coordinator has gone, and job %d with it: %s" % (job.number, gone), gone.code) from gone
                self.status("the coordinator does not answer; waiting for it")
            self.rest(LOOK_S)

    def rest(self, limit_s):
        end = time.monotonic() + limit_s
        while time.monotonic() < end:
            self.tick()
            time.sleep(farm.TICK_S)

    def take(self, job, folder):
        path = os.path.join(folder, "picture.exr")
        job.fetch(path)
        self.show(path, whole=True)

    def keep(self, job, folder):
        """After Esc: the job's picture with the samples that it has; else the last preview stays."""
        self.status("stopped: fetches the picture as it is")
        try:
            info = job.info()
            if info["samples_done"] == 0:
                return job.cancel()
            job.finish()
            end = time.monotonic() + END_PATIENCE_S
            while job.info()["state"] != "done":
                if time.monotonic() > end:
                    raise farm.Trouble("the job's picture did not come in %g s: this is the last preview" % END_PATIENCE_S)
                time.sleep(farm.TICK_S)
            self.take(job, folder)
        except (farm.Trouble, exr.BadFile) as problem:
            self.note("stopped: %s" % problem)
        return None

    def abandon(self, job):
        self.stopped = True
        try:
            if job.info()["state"] not in ("done", "failed", "cancelled"):
                job.cancel()
        except farm.Trouble:
            pass


class AzulejoEngine(bpy.types.RenderEngine):
    """Blender makes these; they have no constructor of their own (Blender 4.4 would want it otherwise)."""
    bl_idname = "AZULEJO"
    bl_label = "Azulejo"
    bl_use_preview = False
    bl_use_eevee_viewport = True
    bl_use_shading_nodes_custom = False   # Cycles' nodes
    bl_use_postprocess = True

    def render(self, depsgraph):
        Current.notes.clear()
        try:
            Frame(self, depsgraph).render()
        except Stopped:
            pass
        except (farm.Trouble, exr.BadFile) as trouble:
            self.fail(str(trouble))
        except Exception as problem:  # pylint: disable=broad-except  # a message, not a traceback, is what an artist can use
            traceback.print_exc()
            self.fail("the add-on made a mistake: %r; the console has more" % problem)
        if not self.is_animation:
            end_session()

    def fail(self, text):
        end_session()
        self.report({"ERROR"}, "Azulejo: " + text)
        self.error_set("Azulejo: " + text)

    def update_render_passes(self, scene=None, renderlayer=None):
        self.register_pass(scene, renderlayer, "Combined", 4, "RGBA", "COLOR")
        for wanted in wanted_passes(scene, renderlayer):
            self.register_pass(scene, renderlayer, wanted.name, len(wanted.letters), wanted.letters, wanted.kind)


HANDLERS = ("render_init", "render_complete", "render_cancel")


def at_render_end(*_):
    end_session()


def register():
    bpy.utils.register_class(AzulejoEngine)
    for name in HANDLERS:
        getattr(bpy.app.handlers, name).append(at_render_end)
    atexit.register(end_session)


def unregister():
    end_session()
    atexit.unregister(end_session)
    for name in HANDLERS:
        handlers = getattr(bpy.app.handlers, name)
        if at_render_end in handlers:
            handlers.remove(at_render_end)
    bpy.utils.unregister_class(AzulejoEngine)
