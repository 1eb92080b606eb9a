/* scene: the one description that importers write and the renderer reads.
 *
 * A scene is a set of flat tables that point into one another by index, plus blobs named by SHA-256 (mesh buffers in
 * the layout below; textures and environment maps in their original files' bytes). It owns nothing outside its arena.
 *
 * Conventions: right-handed, +Y up, metres; cameras look along -Z of their node; colours are linear Rec. 709; radiance
 * units are glTF's, one to one (1 nit = 1, 1 cd = 1 W/sr). Invariant: a scene that scene_validate() accepted can be
 * rendered without further range checks of an index or a count.
 */
#pragma once

#include <stdint.h>

#include "common/base/arena.h"
#include "common/base/digest.h"
#include "common/base/status.h"
#include "common/math/transform.h"
#include "common/math/vec.h"
#include "common/scene/material_fields.h"

enum {
    SCENE_INSTANCES_MAX = 1 << 24,
    SCENE_MESHES_MAX = 1 << 22,
    SCENE_MATERIALS_MAX = 1 << 20,
    SCENE_TEXTURES_MAX = 1 << 16,
    SCENE_IMAGES_MAX = 1 << 16,
    SCENE_LIGHTS_MAX = 1 << 20,
    SCENE_CAMERAS_MAX = 1 << 12,
    SCENE_NODES_MAX = 1 << 22,
    SCENE_CHANNELS_MAX = 1 << 20,   /* animation channels */
    SCENE_TRACKS_MAX = 1 << 20,     /* values that are animated */
    SCENE_KEYS_MAX = 1 << 22,       /* keys of one channel, or track */
    SCENE_SKINS_MAX = 1 << 16,
    SCENE_JOINTS_MAX = 1 << 16,     /* of one skin */
    SCENE_MORPHS_MAX = 1 << 10,     /* morph targets of one mesh */
    SCENE_MEDIA_MAX = 1 << 12,
    SCENE_PORTALS_MAX = 1 << 8,
    SCENE_GRID_SIDE_MAX = 1 << 12,  /* cells along one side of a medium's grid */
    SCENE_NAME_MAX = 255,
    SCENE_TRIANGLES_MAX = 1 << 28, /* in one mesh */
    SCENE_MESH_PADDING_BYTES = 16, /* zeros at the end of a mesh blob */
    SCENE_WIRE_VERSION = 3,
    SCENE_WIRE_BYTES_MAX = 1 << 30,    /* of a packed scene */
    SCENE_ELEMENT_BYTES_MAX = 1 << 12, /* of one mesh, material, ... in its packed form */
    SCENE_NODE_BYTES_MAX = SCENE_ELEMENT_BYTES_MAX + 4 * SCENE_MORPHS_MAX, /* likewise a node */
    SCENE_CHANNEL_BYTES_MAX = 1 << 28,
    SCENE_SKIN_BYTES_MAX = SCENE_ELEMENT_BYTES_MAX + 56 * SCENE_JOINTS_MAX,
    SCENE_PRIORITY_MAX = 1000,         /* of a material's volume; the least is its negative */
    SCENE_BLADES_MAX = 1024,
};
#define SCENE_BLOB_BYTES_MAX ((uint64_t)1 << 36)
/* No coordinate of a mesh or of the world may be larger, so that squares of lengths and cross
 * products stay finite in float. */
#define SCENE_COORDINATE_MAX 1e15f
#define SCENE_RADIANCE_MAX 1e30f    /* and any intensity: squares and sums of it stay finite */
/* Of a medium, per metre: a scene of a nanometre's size may be opaque. */
#define SCENE_COEFFICIENT_MAX 1e12f
#define SCENE_FOCUS_MAX 1e12f       /* distance, and radius of the lens, in metres */
/* Of a picture from top to bottom: the tangent of half of it must be usable. */
#define SCENE_FOV_MIN_RAD 1e-5f
#define SCENE_FOV_MAX_RAD 3.1415f

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
    MESH_SKIN = 1 << 5,     /* struct mesh_influence: joints of the instance's skin */
    MESH_SPHERE = 1 << 6,   /* no array: the triangles stand in for the sphere around the origin on
                               which the vertices lie (worker/render/shape/sphere.c) */
    MESH_STAND_INS = MESH_SPHERE, /* what is no array but says what the triangles stand in for */
    MESH_ARRAYS_ALL = 127,
};

/* What moves one vertex of a skinned mesh; weights >= 0 that add up to 1 (up to rounding). */
struct mesh_influence {
    float weight[4];
    uint16_t joint[4]; /* index into the skin's joints */
};

/* A triangle mesh. Its blob holds, little-endian and without gaps, in this order: positions float[3][vertices], then
 * each array of `arrays` in the order of the enum, [vertices] each, then for each morph target its position offsets
 * float[3][vertices] and, if the mesh has normals, its normal offsets float[3][vertices], then indices
 * uint32[3][triangles], then 16 zero bytes (so that SIMD loads of the last element stay inside). See
 * scene_mesh_layout(). A joint index is checked when the mesh is deformed. */
struct scene_mesh {
    const char *name;
    struct scene_blob blob;
    uint32_t vertex_count;
    uint32_t triangle_count;
    uint32_t arrays;      /* enum scene_mesh_arrays */
    uint32_t morph_count; /* morph targets */
    float bounds_min[3], bounds_max[3];
    int closed; /* watertight and wound outwards: no ray from outside can meet a
                                   back face first, so culling an opaque surface changes nothing */
};

/* Byte offsets of a mesh blob's arrays; SIZE_MAX where absent. */
struct scene_mesh_layout {
    size_t positions, normals, tangents, uv0, uv1, colors, skin, morphs, indices, total_bytes;
    size_t morph_stride; /* bytes from one morph target to the next */
};
void scene_mesh_layout(const struct scene_mesh *mesh, struct scene_mesh_layout *out);

/* An image file: PNG, JPEG, WebP, Radiance HDR or OpenEXR, recognised by its first bytes. */
struct scene_image {
    const char *name;
    struct scene_blob blob;
};

enum scene_wrap { WRAP_REPEAT, WRAP_CLAMP, WRAP_MIRROR, WRAP_BLACK, WRAP_COUNT };

/* How the colour channels of an 8 or 16 bit image are encoded. */
enum scene_encoding {
    ENCODING_BY_SLOT, /* sRGB in slots that hold colours, linear in the others (glTF) */
    ENCODING_LINEAR,
    ENCODING_SRGB,
    ENCODING_COUNT
};

struct scene_texture {
    uint32_t image;
    enum scene_wrap wrap_u, wrap_v;
    int nearest; /* nearest texel instead of filtering */
    enum scene_encoding encoding;
};

/* A material's reference to a texture. uv' = (m00 u + m01 v + m02, m10 u + m11 v + m12);
 * v runs downwards as in glTF (0 at the image's top row). */
struct scene_texture_slot {
    int32_t texture; /* -1: none, only the factor counts */
    uint32_t uv_set; /* 0 or 1 */
    float uv_transform[2][3];
};

enum scene_alpha_mode { ALPHA_OPAQUE, ALPHA_MASK, ALPHA_BLEND, ALPHA_COUNT };

enum scene_material_kind {
    MATERIAL_SURFACE,   /* glTF 2.0's metallic-roughness model and its extensions */
    MATERIAL_CONDUCTOR, /* a metal by its complex index; roughness, anisotropy and clearcoat act */
    MATERIAL_INTERFACE, /* no surface: rays pass; it only bounds `medium` */
    MATERIAL_MIX,       /* at every point one of two others, at random */
    MATERIAL_KIND_COUNT
};

/* What a surface is made of: a member for each row of material_fields.h. Every texture multiplies its factor, so a
 * factor of 0 is 0 whatever the texture. Normal textures and anisotropy act only on meshes with MESH_TANGENTS.
 * The model: glTF 2.0's metallic-roughness model with the extensions anisotropy, clearcoat, diffuse_transmission,
 * dispersion, emissive_strength, ior, iridescence, sheen, specular, transmission, unlit and volume. roughness is
 * perceptual: GGX alpha = roughness^2. scene_material_default() switches every extension off. */
#define MATERIAL_MEMBER_FLAG(name) int name;
#define MATERIAL_MEMBER_NUMBER(name) float name;
#define MATERIAL_MEMBER_RGB(name) float name[3];
#define MATERIAL_MEMBER_RGBA(name) float name[4];
#define MATERIAL_MEMBER_INTEGER(name) int name;
#define MATERIAL_MEMBER_KIND(name) enum scene_material_kind name;
#define MATERIAL_MEMBER_ALPHA_MODE(name) enum scene_alpha_mode name;
#define MATERIAL_MEMBER_MEDIUM(name) int32_t name;
#define MATERIAL_MEMBER_MATERIALS(name) uint32_t name[2];
#define MATERIAL_VALUE_MEMBER(type, name, ...) MATERIAL_MEMBER_##type(name)
#define MATERIAL_TEXTURE_MEMBER(name, ...) struct scene_texture_slot name##_texture;
#define MATERIAL_TEXTURE_NUMBER(name, ...) MATERIAL_TEXTURE_##name,
#define MATERIAL_SKIP(...)

enum material_texture {
    MATERIAL_FIELDS(MATERIAL_SKIP, MATERIAL_TEXTURE_NUMBER)
    MATERIAL_TEXTURES /* how many a material has */
};

struct scene_material {
    const char *name;
    MATERIAL_FIELDS(MATERIAL_VALUE_MEMBER, MATERIAL_SKIP)
    union {
        struct {
            MATERIAL_FIELDS(MATERIAL_SKIP, MATERIAL_TEXTURE_MEMBER)
        };
        struct scene_texture_slot textures[MATERIAL_TEXTURES]; /* the same, in the rows' order */
    };
};

/* One placement of a mesh with one material. */
struct scene_instance {
    const char *name;
    const char *asset; /* the name of the file's topmost thing that it is a part of; "": itself */
    uint32_t mesh;
    uint32_t material;
    struct transform_d to_world; /* invertible; a negative determinant mirrors the mesh: the
                                    renderer then reverses the winding, and so which side is the
                                    front (the glTF rule) */
    int32_t node;                /* >= 0: to_world follows this node (to_world is its value at
                                   time 0; at any time it may be singular: a scale of 0 hides an
                                   object); -1: it does not move */
    int32_t skin;                /* of a mesh with MESH_SKIN, -1: none. A skinned vertex is in
                                   world space after its joints: to_world is then not used */
    int32_t body;                /* the material whose body it bounds (VOLUMES_NESTED), -1: its own.
                                   Another one if meshes of several materials enclose one volume:
                                   all of them then bound the body of one of the materials */
    int sealed;                  /* its mesh and others of its body form a closed surface: each of
                                   their edges is shared, at equal positions, and they are wound
                                   outwards. They do not move */
};

/* Nodes exist only for what moves, and for its parents. Their chain is the file's own, in the
 * file's coordinates: scene_pose_init() subtracts the scene's origin at its end. */
struct scene_node {
    int32_t parent; /* lower than its own index, -1: the world */
    int has_matrix; /* `matrix` replaces translation, rotation and scale */
    struct transform_d matrix;
    double translation[3], rotation[4] /* unit quaternion x y z w */, scale[3];
    float *weights; /* [weight_count] of the mesh's morph targets */
    uint32_t weight_count;
};

enum scene_channel_path { PATH_TRANSLATION, PATH_ROTATION, PATH_SCALE, PATH_WEIGHTS, PATH_COUNT };
enum scene_interpolation { INTERPOLATE_STEP, INTERPOLATE_LINEAR, INTERPOLATE_CUBIC, INTERPOLATE_COUNT };

/* One animated property of one node: glTF's channel and sampler in one. Before the first key and
 * after the last the value is constant. Rotations are interpolated along the great circle. */
struct scene_channel {
    uint32_t node;
    enum scene_channel_path path;
    enum scene_interpolation interpolation;
    uint32_t key_count;  /* >= 1 */
    uint32_t components; /* 3, 4 (rotation) or the node's weight_count */
    float *times;        /* [key_count] seconds, strictly ascending */
    float *values;       /* [key_count][components]; INTERPOLATE_CUBIC:
                                   [key_count][3][components] in-tangent, value, out-tangent */
};

/* The number of floats in `values`. */
static inline size_t scene_channel_floats(const struct scene_channel *channel)
{
    size_t values = channel->interpolation == INTERPOLATE_CUBIC ? 3 : 1;

    return values * channel->key_count * channel->components;
}

/* What a track animates: track.h. */
enum scene_track_target {
    TRACK_MATERIAL,      /* numbers of a material */
    TRACK_UV_SCALE,      /* of a material's texture: uv' = T R S uv, in this order of its tracks */
    TRACK_UV_ROTATION,
    TRACK_UV_OFFSET,
    TRACK_INSTANCE,      /* its visibility: below 0.5 it is hidden */
    TRACK_LIGHT,
    TRACK_CAMERA,
    TRACK_TARGETS
};

/* An animated value that is not a node's: that of the frame's time, also while the shutter is open. The table itself holds
 * the largest of its keys, so that what a scene may need in any frame follows from it. */
struct scene_track {
    enum scene_track_target target;
    uint32_t row;              /* of the target's table */
    uint32_t field;            /* which of its values: track.h */
    uint32_t factor;           /* 0: it is the value; 1, 2 ...: it multiplies it */
    struct scene_channel keys; /* its node is 0 and its path PATH_WEIGHTS: numbers, without a meaning of their own */
};

struct scene_skin {
    uint32_t joint_count;
    uint32_t *joints;                      /* [joint_count] nodes */
    struct transform_stored *inverse_bind; /* [joint_count] mesh space to joint space */
};

/* A participating medium. Coefficients are per metre of world length, RGB, for density 1. */
struct scene_medium {
    const char *name;
    float absorption[3], scattering[3];
    float emission[3];                /* radiance per metre at density 1 (absorption included) */
    float g;                          /* Henyey-Greenstein, -1 < g < 1: forward positive */
    int has_grid;                     /* density varies: the grid's, trilinear, 0 outside its box */
    struct scene_blob grid;           /* float32 little-endian [size z][size y][size x], cell centres */
    uint32_t grid_size[3];            /* cells along x, y, z */
    struct transform_d grid_to_world; /* from the unit cube */
};

/* A window through which the environment shines in: a parallelogram corner + s e1 + t e2. */
struct scene_portal {
    double corner[3];
    float edge1[3], edge2[3];
};

/* Which parts of its pose a kind of light uses: position, direction, to_world. */
enum scene_light_parts { LIGHT_HAS_PLACE = 1, LIGHT_HAS_DIRECTION = 2, LIGHT_HAS_FRAME = 4 };

/* X(KIND, text, parts), by their numbers on the wire. Goniometric: a point light times a lat-long image
 * over its sphere of directions. Projection: a slide projector, a point light times an image in its
 * frustum. */
#define SCENE_LIGHT_KINDS(X)                                          \
    X(POINT, "point", LIGHT_HAS_PLACE)                                \
    X(SPOT, "spot", LIGHT_HAS_PLACE | LIGHT_HAS_DIRECTION)            \
    X(DIRECTIONAL, "directional", LIGHT_HAS_DIRECTION)                \
    X(GONIOMETRIC, "goniometric", LIGHT_HAS_PLACE | LIGHT_HAS_FRAME)  \
    X(PROJECTION, "projection", LIGHT_HAS_PLACE | LIGHT_HAS_FRAME)

enum scene_light_kind {
#define SCENE_LIGHT_ENUM(KIND, text, parts) LIGHT_##KIND,
    SCENE_LIGHT_KINDS(SCENE_LIGHT_ENUM)
#undef SCENE_LIGHT_ENUM
        LIGHT_KIND_COUNT
};

static inline unsigned scene_light_parts(enum scene_light_kind kind)
{
#define SCENE_LIGHT_PARTS(KIND, text, parts) parts,
    static const unsigned kinds[LIGHT_KIND_COUNT] = {SCENE_LIGHT_KINDS(SCENE_LIGHT_PARTS)};
#undef SCENE_LIGHT_PARTS

    return kinds[kind];
}

/* How a spot light falls off between its cones. */
enum scene_falloff { FALLOFF_GLTF /* square of the linear ramp of the cosine */,
                     FALLOFF_SMOOTHSTEP /* of the cosine (pbrt-v4) */,
                     FALLOFF_FOURTH /* power of that ramp (pbrt-v3) */, FALLOFF_COUNT };

struct scene_light {
    const char *name;
    enum scene_light_kind kind;
    double position[3]; /* world; unused by directional lights */
    float direction[3]; /* world, unit: where the light shines to */
    float intensity[3]; /* RGB: W/sr (point, spot), W/m^2 (directional) */
    float range;        /* metres, 0: unlimited */
    float inner_cone_rad, outer_cone_rad;
    enum scene_falloff falloff;
    int32_t image;               /* goniometric, projection: index into images, -1: white */
    struct transform_d to_world; /* goniometric, projection: orthonormal frame; looks along -Z, the
                                   image's up is +Y. Goniometric: lat-long as the environment */
    float projection_yfov_rad;
    float projection_aspect; /* width / height of the slide */
    int32_t node;            /* >= 0: it shines from this node along its -Z */
};

enum scene_camera_kind {
    CAMERA_PERSPECTIVE,
    CAMERA_ORTHOGRAPHIC,
    CAMERA_PANORAMA, /* lat-long over the whole sphere: -Z in the middle, +Y at the top */
    CAMERA_KIND_COUNT
};

struct scene_camera {
    const char *name;
    enum scene_camera_kind kind;
    struct transform_d to_world; /* rotation and translation only, orthonormal */
    float yfov_rad;              /* perspective: full vertical angle */
    float xmag, ymag;            /* orthographic: half width and half height, metres */
    float aspect;                /* width / height that the file asks for; 0: none */
    float lens_radius;           /* metres; 0: pinhole */
    float focus_distance;        /* metres along the axis to the plane of focus; > 0 if there is
                                   a lens */
    uint32_t blades;             /* of the aperture; below 3: round */
    float blade_rotation_rad;
    float shutter_open_s, shutter_close_s; /* relative to the frame's time; equal: the job's
                                   settings decide */
    float exposure_ev;                     /* stops that bring the file's physical units to a middle exposure;
                                   the client adds them to the job's when it submits it */
    int32_t node;                          /* >= 0: to_world follows this node */
};

/* Lat-long map: row 0 is the zenith (+Y); with the map's own u = 0.5 + atan2(z, x)/(2 pi) (so -Z is at u = 0.25, +X at
 * 0.5), as in glTF viewers and Cycles. Rotation and strength come from the job's settings. */
struct scene_environment {
    int present;
    struct scene_image image; /* unused when `constant` */
    int constant;             /* the same radiance from everywhere */
    float radiance[3];        /* for `constant`; multiplies the map */
    float brightest;          /* the largest value of the map, at most SCENE_RADIANCE_MAX; 0: black, or not known */
    int varies;               /* an importer found more than one colour in the map; not packed */
    float to_map[3][3];       /* rotation from world to the map's axes, before the job's own */
    uint32_t portal_count;
    struct scene_portal *portals;
};

/* Which boundaries of refractive volumes and media count.
 * VOLUMES_NESTED: a path counts the bodies that it is inside. A body is everything that one material bounds
 * (scene_instance.body). Where several overlap, the one of the highest priority fills the space; ties go to the
 * innermost. The boundaries of the others do not count. VOLUMES_BOUNDARIES: every face is a boundary (pbrt's rule). */
enum scene_volume_rule { VOLUMES_NESTED, VOLUMES_BOUNDARIES, VOLUME_RULE_COUNT };

struct scene {
    struct arena arena; /* owns every name and table below */
    const char *name;   /* every name: UTF-8 without control characters, at most
                                   SCENE_NAME_MAX bytes, never NULL */
    uint32_t mesh_count, image_count, texture_count, material_count, instance_count, light_count, camera_count,
        node_count, channel_count, track_count, skin_count, medium_count;
    struct scene_mesh *meshes;
    struct scene_image *images;
    struct scene_texture *textures;
    struct scene_material *materials;
    struct scene_instance *instances;
    struct scene_light *lights;
    struct scene_camera *cameras; /* at least one: importers add one that frames the scene */
    struct scene_environment environment;
    struct scene_node *nodes;
    struct scene_channel *channels; /* sorted by node, then path; none twice */
    struct scene_track *tracks;     /* sorted by target, row, field, factor; none twice */
    struct scene_skin *skins;
    struct scene_medium *media;
    int32_t fog;      /* the medium that fills the scene's bounding sphere, -1: none */
    double origin[3]; /* the world's origin in the file's coordinates, metres. Every
                                   position except the nodes' is relative to it, so that a scene far
                                   from the file's origin keeps its precision in float */
    enum scene_volume_rule volume_rule;
};

void scene_init(struct scene *scene);
void scene_release(struct scene *scene);

/* glTF's default material values (base colour 1, metallic 1, roughness 1, ior 1.5 ...). */
void scene_material_default(struct scene_material *material);
/* No references, everything optional absent: for tables that are filled in field by field. */
void scene_instance_default(struct scene_instance *instance);
void scene_light_default(struct scene_light *light);
void scene_camera_default(struct scene_camera *camera);
void scene_environment_default(struct scene_environment *environment);
void scene_node_default(struct scene_node *node);
void scene_medium_default(struct scene_medium *medium);

/* Do all three channels of the colour have this value? */
static inline int scene_color_is(const float color[3], float value)
{
    return color[0] == value && color[1] == value && color[2] == value;
}

/* Where to find a blob's bytes; they must stay valid as long as what reads them says. */
struct scene_blob_reader {
    status (*get)(void *user, const struct digest *digest, const uint8_t **data, size_t *size_bytes, struct error *err);
    void *user;
};

/* Check every index, count, enum and number. ERR_INPUT names the table, the row and the field. */
status scene_validate(const struct scene *scene, struct error *err) MUST_CHECK;

/* The wire form (common/scene/scene.proto). Pack appends to `out`. Unpack does not trust its input,
 * initialises `scene` first, and validates. */
struct buffer;
status scene_pack(const struct scene *scene, struct buffer *out, struct error *err) MUST_CHECK;
/* On failure the scene is left initialised and empty. Unpacking needs memory in proportion to the
 * elements' true counts, not to what a length field claims. */
status scene_unpack(struct scene *scene, const void *data, size_t size_bytes, struct error *err) MUST_CHECK;

/* The distinct blobs that a worker needs to render the scene: meshes, images, environment,
 * grids.
 * *out is mem_alloc'd with *count entries; the caller frees. */
status scene_blobs(const struct scene *scene, struct scene_blob **out, size_t *count, struct error *err) MUST_CHECK;

/* World bounds of one instance (of its mesh's box), in double; 0 if they are not finite. */
int scene_instance_bounds(const struct scene *scene, uint32_t instance, double bounds_min[3], double bounds_max[3]);

/* World bounds of all instances; 0 if there is no finite geometry. */
int scene_bounds(const struct scene *scene, float bounds_min[3], float bounds_max[3]);
