/* scene: the one description that importers write and the renderer reads.
 *
 * A scene is a set of flat tables that point into one another by index, plus blobs named
 * by SHA-256 (mesh buffers in the layout below; textures and environment maps in their
 * original files' bytes). It owns nothing outside its arena.
 *
 * Conventions: right-handed, +Y up, metres; cameras look along -Z of their node; colours
 * are linear Rec. 709; radiance units are those of glTF taken one to one (1 nit = 1,
 * 1 cd = 1 W/sr). Invariant: a scene that scene_validate() accepted can be rendered
 * without any further range check of an index or a count.
 */
#ifndef AZULEJO_SCENE_SCENE_H
#define AZULEJO_SCENE_SCENE_H

#include <stdint.h>

#include "common/base/arena.h"
#include "common/base/digest.h"
#include "common/base/status.h"
#include "common/math/transform.h"
#include "common/math/vec.h"

enum {
    SCENE_INSTANCES_MAX = 1 << 24,
    SCENE_MESHES_MAX = 1 << 22,
    SCENE_MATERIALS_MAX = 1 << 20,
    SCENE_TEXTURES_MAX = 1 << 16,
    SCENE_IMAGES_MAX = 1 << 16,
    SCENE_LIGHTS_MAX = 1 << 20,
    SCENE_CAMERAS_MAX = 1 << 12,
    SCENE_NAME_MAX = 255,
    SCENE_TRIANGLES_MAX = 1 << 28, /* in one mesh */
    SCENE_MESH_PADDING_BYTES = 16, /* zeros at the end of a mesh blob */
    SCENE_WIRE_VERSION = 1,
    SCENE_WIRE_BYTES_MAX = 1 << 30,    /* of a packed scene */
    SCENE_ELEMENT_BYTES_MAX = 1 << 12, /* of one mesh, material, ... in its packed form */
};
#define SCENE_BLOB_BYTES_MAX ((uint64_t)1 << 36)
/* No coordinate of a mesh or of the world may be larger: squares of lengths and cross
 * products must stay finite in float. */
#define SCENE_COORDINATE_MAX 1e15f

struct scene_blob {
    struct digest digest;
    uint64_t size_bytes;
};

/* Which optional vertex arrays a mesh blob holds. */
enum scene_mesh_arrays {
    MESH_NORMALS = 1 << 0,  /* float[3] unit */
    MESH_TANGENTS = 1 << 1, /* float[4] unit, w = +1 or -1: handedness of the bitangent */
    MESH_UV0 = 1 << 2,      /* float[2] */
    MESH_UV1 = 1 << 3,      /* float[2] */
    MESH_COLORS = 1 << 4,   /* float[4] linear RGBA */
    MESH_ARRAYS_ALL = 31,
};

/* A triangle mesh. Its blob holds, little-endian and without gaps, in this order:
 * positions float[3][vertices], then each array of `arrays` in the order of the enum,
 * [vertices] each, then indices uint32[3][triangles], then 16 zero bytes (so that SIMD
 * loads of the last element stay inside). See scene_mesh_layout(). */
struct scene_mesh {
    const char *name;
    struct scene_blob blob;
    uint32_t vertex_count;
    uint32_t triangle_count;
    uint32_t arrays;            /* enum scene_mesh_arrays */
    float bounds_min[3], bounds_max[3];
    int closed;                 /* watertight and wound outwards: no ray from outside can meet a
                                   back face first, so culling an opaque surface changes nothing */
};

/* Byte offsets of a mesh blob's arrays; SIZE_MAX where absent. */
struct scene_mesh_layout {
    size_t positions, normals, tangents, uv0, uv1, colors, indices, total_bytes;
};
void scene_mesh_layout(const struct scene_mesh *mesh, struct scene_mesh_layout *out);

/* An image file: PNG, JPEG, Radiance HDR or OpenEXR, recognised by its first bytes. */
struct scene_image {
    const char *name;
    struct scene_blob blob;
};

enum scene_wrap { WRAP_REPEAT, WRAP_CLAMP, WRAP_MIRROR, WRAP_COUNT };

struct scene_texture {
    uint32_t image;
    enum scene_wrap wrap_u, wrap_v;
    int nearest;            /* nearest texel instead of bilinear */
};

/* A material's reference to a texture. uv' = (m00 u + m01 v + m02, m10 u + m11 v + m12);
 * v runs downwards as in glTF (0 at the image's top row). */
struct scene_texture_slot {
    int32_t texture;        /* -1: none, the factor alone counts */
    uint32_t uv_set;        /* 0 or 1 */
    float uv_transform[2][3];
};

enum scene_alpha_mode { ALPHA_OPAQUE, ALPHA_MASK, ALPHA_BLEND, ALPHA_COUNT };

/* What a surface is made of. Every texture multiplies its factor, so a factor of 0 is 0
 * whatever the texture. A normal texture acts only on meshes with MESH_TANGENTS.
 * The model: glTF 2.0's metallic-roughness model with the extensions
 * specular, ior, transmission, volume (refraction and absorption), emissive_strength and
 * unlit. roughness is perceptual: GGX alpha = roughness^2. */
struct scene_material {
    const char *name;
    int unlit;                              /* emits base_color, reflects nothing */
    int double_sided;                       /* 0: back faces are invisible to every ray */
    enum scene_alpha_mode alpha_mode;
    float alpha_cutoff;
    float base_color[4];                    /* linear RGB 0..1, alpha */
    struct scene_texture_slot base_color_texture;   /* sRGB, alpha linear */
    float metallic, roughness;              /* 0..1 */
    struct scene_texture_slot metallic_roughness_texture; /* G roughness, B metallic */
    float normal_scale;
    struct scene_texture_slot normal_texture;
    float emission[3];                      /* radiance: factor * strength, >= 0 */
    struct scene_texture_slot emission_texture;     /* sRGB */
    float ior;                              /* >= 1, or 0: Fresnel exactly 1 */
    float specular;                         /* weight of the dielectric reflection, 0..1 */
    struct scene_texture_slot specular_texture;     /* A */
    float specular_color[3];                /* >= 0, may exceed 1 */
    struct scene_texture_slot specular_color_texture; /* sRGB */
    float transmission;                     /* 0..1 */
    struct scene_texture_slot transmission_texture; /* R */
    int refractive;                         /* 1: bounds a volume and refracts; 0: thin wall */
    float attenuation_color[3];             /* transmittance after attenuation_distance */
    float attenuation_distance;             /* metres; INFINITY: clear */
};

/* One mesh with one material somewhere in the world. */
struct scene_instance {
    const char *name;
    uint32_t mesh;
    uint32_t material;
    struct transform to_world;  /* invertible; a negative determinant mirrors the mesh: the
                                   renderer flips the winding, and thus the side that counts as
                                   front, by its sign (the glTF rule) */
};

enum scene_light_kind { LIGHT_POINT, LIGHT_SPOT, LIGHT_DIRECTIONAL, LIGHT_KIND_COUNT };

struct scene_light {
    const char *name;
    enum scene_light_kind kind;
    float position[3];          /* world; unused by directional lights */
    float direction[3];         /* world, unit: where the light shines to */
    float intensity[3];         /* RGB: W/sr (point, spot), W/m^2 (directional) */
    float range;                /* metres, 0: unlimited */
    float inner_cone_rad, outer_cone_rad;
};

enum scene_camera_kind { CAMERA_PERSPECTIVE, CAMERA_ORTHOGRAPHIC, CAMERA_KIND_COUNT };

struct scene_camera {
    const char *name;
    enum scene_camera_kind kind;
    struct transform to_world;  /* rotation and translation only, orthonormal */
    float yfov_rad;             /* perspective: full vertical angle */
    float xmag, ymag;           /* orthographic: half width and half height, metres */
    float aspect;               /* width / height that the file asks for; 0: none */
};

/* Lat-long map: row 0 is the zenith (+Y); with the map's own u = 0.5 + atan2(z, x)/(2 pi)
 * (so -Z is at u = 0.25, +X at 0.5), as in glTF viewers and Cycles. Rotation and strength
 * come from the job's settings. */
struct scene_environment {
    int present;
    struct scene_image image;   /* unused when `constant` */
    int constant;               /* the same radiance from everywhere */
    float radiance[3];          /* for `constant` */
};

struct scene {
    struct arena arena;         /* owns every name and table below */
    const char *name;           /* every name: UTF-8 without control characters, at most
                                   SCENE_NAME_MAX bytes, never NULL */
    uint32_t mesh_count, image_count, texture_count, material_count, instance_count,
        light_count, camera_count;
    struct scene_mesh *meshes;
    struct scene_image *images;
    struct scene_texture *textures;
    struct scene_material *materials;
    struct scene_instance *instances;
    struct scene_light *lights;
    struct scene_camera *cameras;  /* at least one: importers frame the scene if need be */
    struct scene_environment environment;
};

void scene_init(struct scene *scene);
void scene_release(struct scene *scene);

/* glTF's default material values (base colour 1, metallic 1, roughness 1, ior 1.5 ...). */
void scene_material_default(struct scene_material *material);

/* Check every index, count, enum and number. ERR_INPUT names the table, the row and the
 * field. */
status scene_validate(const struct scene *scene, struct error *err) MUST_CHECK;

/* The wire form (common/scene/scene.proto). Pack appends to `out`. Unpack treats its input
 * as hostile, initialises `scene` first, and validates. */
struct buffer;
status scene_pack(const struct scene *scene, struct buffer *out, struct error *err) MUST_CHECK;
/* On failure the scene is left initialised and empty. Unpacking needs memory in proportion
 * to the elements' true counts, not to what a length field claims. */
status scene_unpack(struct scene *scene, const void *data, size_t size_bytes,
                    struct error *err) MUST_CHECK;

/* The distinct blobs that a worker needs to render the scene: meshes, images, environment.
 * *out is mem_alloc'd with *count entries; the caller frees. */
status scene_blobs(const struct scene *scene, struct scene_blob **out, size_t *count,
                   struct error *err) MUST_CHECK;

/* World bounds of one instance (of its mesh's box), in double; 0 when not finite. */
int scene_instance_bounds(const struct scene *scene, uint32_t instance, double bounds_min[3],
                          double bounds_max[3]);

/* World bounds of all instances; 0 when there is no finite geometry. */
int scene_bounds(const struct scene *scene, float bounds_min[3], float bounds_max[3]);

#endif
