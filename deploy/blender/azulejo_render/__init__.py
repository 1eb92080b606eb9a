"""Azulejo as a render engine of Blender 3.4 to 4.x: docs/BLENDER.md."""

bl_info = {
    "name": "Azulejo",
    "author": "The Azulejo project",
    "version": (0, 2, 0),
    "blender": (3, 4, 0),
    "location": "Properties > Render > Render Engine",
    "description": "Renders on this machine or on a farm, and shows the picture as it becomes right",
    "category": "Render",
}

try:
    import bpy  # noqa: F401  # pylint: disable=unused-import
except ModuleNotFoundError:  # the tests of the parts that need no Blender
    bpy = None

if bpy:
    from . import engine, panel

    def register():
        panel.register()
        engine.register()

    def unregister():
        engine.unregister()
        panel.unregister()
