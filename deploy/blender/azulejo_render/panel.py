"""The scene's settings, and where the panels show them."""
import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from . import engine, passes

# What a view layer is asked for. Cycles' names where it has them.
NAMES = {"azulejo_denoising": "Denoising Data", "use_pass_cryptomatte_object": "Cryptomatte Object",
         "use_pass_cryptomatte_material": "Cryptomatte Material", "use_pass_cryptomatte_asset": "Cryptomatte Asset"}
FLAGS = {p.flag: NAMES.get(p.flag, p.name) for p in passes.PASSES if p.flag != passes.DENOISED}
LAYER_FLAGS = [flag for flag in FLAGS if flag.startswith("azulejo_")]
NOTES_SHOWN = 20


def update_render_passes(settings, _context):
    for layer in settings.id_data.view_layers:
        layer.update_render_passes()


class AzulejoSettings(bpy.types.PropertyGroup):
    samples: IntProperty(name="Samples", min=0, max=1 << 20, default=256, description="Samples a pixel, at most; 0: no limit")
    target_error: StringProperty(
        name="Target Error", default="",
        description="Render until the error is this small: 2/255 (95 % of the pixels are within this many display codes), "
                    "1% (of the mean) or 45dB. Empty: until the samples are used up")
    time_limit: FloatProperty(name="Time Limit", min=0, default=0, unit="NONE", description="Seconds for a frame; 0: no limit")
    max_depth: IntProperty(name="Path Length", min=0, max=1024, default=12, description="Edges of a path after the camera's ray")
    denoise: EnumProperty(
        name="Denoise", default="OFF", update=update_render_passes,
        description="Show the picture without its noise; the pass Noisy Image is the picture with it", items=(
            ("OFF", "Off", "The picture as it was rendered"),
            ("ON", "On", "As well as the samples allow"),
            ("FAST", "Fast", "With less work, and less well")))
    seed: IntProperty(name="Seed", min=0, default=0, description="Another seed gives other noise; each frame adds its number")
    device: EnumProperty(name="Device", default="LOCAL", items=(
        ("LOCAL", "This Machine", "Start a coordinator and a worker here, as long as the render lasts"),
        ("FARM", "Farm", "Send the scene to a farm's coordinator")))
    threads: IntProperty(name="Threads", min=0, max=1024, default=0, description="0: all processors")
    address: StringProperty(name="Coordinator", default="127.0.0.1:7420", description="HOST or HOST:PORT")
    key_file: StringProperty(name="Key", subtype="FILE_PATH", default="",
                             description="A key of the role client. Empty: ~/.config/azulejo/farm.key")
    priority: IntProperty(name="Priority", default=0, description="Jobs with a higher number go first")
    patience: FloatProperty(name="Wait for It", min=0, default=60,
                            description="Seconds to wait for a coordinator that does not answer, before the render fails")
    program: StringProperty(name="azulejo", subtype="FILE_PATH", default="",
                            description="The program azulejo, or its folder. Empty: found by PATH")


class Panel:
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"
    COMPAT_ENGINES = {"AZULEJO"}

    @classmethod
    def poll(cls, context):
        return context.engine in cls.COMPAT_ENGINES

    def column(self):
        self.layout.use_property_split = True
        self.layout.use_property_decorate = False
        return self.layout.column()


class AZULEJO_PT_sampling(Panel, bpy.types.Panel):
    bl_label = "Sampling"

    def draw(self, context):
        column = self.column()
        for name in ("samples", "target_error", "time_limit", "denoise", "max_depth", "seed"):
            column.prop(context.scene.azulejo, name)


class AZULEJO_PT_device(Panel, bpy.types.Panel):
    bl_label = "Device"

    def draw(self, context):
        settings, column = context.scene.azulejo, self.column()
        column.prop(settings, "device")
        names = ("threads", ) if settings.device == "LOCAL" else ("address", "key_file", "priority", "patience")
        for name in names + ("program", ):
            column.prop(settings, name)


class AZULEJO_PT_film(Panel, bpy.types.Panel):
    bl_label = "Film"

    def draw(self, context):
        column = self.column()
        cycles = getattr(context.scene, "cycles", None)
        if cycles:
            column.prop(cycles, "film_exposure")
            column.prop(cycles, "pixel_filter_type", text="Pixel Filter")
            if cycles.pixel_filter_type != "BOX":
                column.prop(cycles, "filter_width", text="Width")
        column.prop(context.scene.render, "film_transparent", text="Transparent")
        column.prop(context.scene.render, "use_motion_blur", text="Motion Blur")
        row = column.row()
        row.active = context.scene.render.use_motion_blur
        row.prop(context.scene.render, "motion_blur_shutter", text="Shutter")


class AZULEJO_PT_notes(Panel, bpy.types.Panel):
    bl_label = "Not Exported"

    def draw(self, context):
        column = self.layout.column()
        notes = engine.Current.notes
        for text in notes[:NOTES_SHOWN]:
            column.label(text=text, icon="ERROR")
        if not notes:
            column.label(text="The last render exported all that it found")
        elif len(notes) > NOTES_SHOWN:
            column.label(text="... and %d more: the console has them" % (len(notes) - NOTES_SHOWN))


class AZULEJO_PT_passes(Panel, bpy.types.Panel):
    bl_label = "Passes"
    bl_context = "view_layer"

    def draw(self, context):
        column = self.column()
        for flag, name in FLAGS.items():
            column.prop(context.view_layer, flag, text=name)
        column.prop(context.view_layer, "pass_cryptomatte_depth", text="Levels")


CLASSES = (AzulejoSettings, AZULEJO_PT_sampling, AZULEJO_PT_device, AZULEJO_PT_film, AZULEJO_PT_notes, AZULEJO_PT_passes)
# Of Blender's and Cycles' panels, those for things that are exported.
SHARED = {"DATA_PT_light", "DATA_PT_EEVEE_light", "EEVEE_WORLD_PT_surface", "EEVEE_MATERIAL_PT_surface", "MATERIAL_PT_preview",
          "MATERIAL_PT_context_material", "EEVEE_MATERIAL_PT_context_material", "DATA_PT_spot", "WORLD_PT_context_world",
          "RENDER_PT_color_management", "RENDER_PT_color_management_curves", "DATA_PT_camera_dof", "DATA_PT_lens",
          "DATA_PT_camera_dof_aperture", "DATA_PT_camera", "DATA_PT_custom_props_light", "DATA_PT_context_light"}


def shared_panels():
    for name in SHARED | {c.__name__ for c in bpy.types.Panel.__subclasses__() if c.__module__.startswith("bl_ui.")}:
        panel = getattr(bpy.types, name, None)
        known = getattr(panel, "COMPAT_ENGINES", None)
        if known is None:
            continue
        if name in SHARED or ("BLENDER_RENDER" in known and "BLENDER_EEVEE" in known and name not in NOT_SHARED):
            yield panel


NOT_SHARED = {"RENDER_PT_freestyle", "VIEWLAYER_PT_freestyle"}


def register():
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.azulejo = PointerProperty(type=AzulejoSettings)
    for flag in LAYER_FLAGS:
        setattr(bpy.types.ViewLayer, flag, BoolProperty(
            name=FLAGS[flag], default=False, update=lambda self, context: self.update_render_passes()))
    for panel in shared_panels():
        panel.COMPAT_ENGINES.add("AZULEJO")


def unregister():
    for panel in shared_panels():
        panel.COMPAT_ENGINES.discard("AZULEJO")
    for flag in LAYER_FLAGS:
        delattr(bpy.types.ViewLayer, flag)
    del bpy.types.Scene.azulejo
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
