/* transform: changes of an imported scene after which its picture must be the same, to the bit or but for noise.
 *
 * A transformation is a row of transforms[] and one function, in a file of its own (transform_faces.c, transform_far.c):
 * it edits import->scene in place, by the helpers below where it needs more meshes or instances, and tells
 * how many things it changed. tests/statistics/test_transforms.c renders every scene with and
 * without each row, so a new row needs nothing else.
 * A failure (out of memory) aborts the program.
 */
#pragma once

#include "client/import/import.h"

struct transform_row {
    const char *name;
    /* Returns the number of things changed; 0: there is nothing to change in this scene, which is then
     * left as it is. Depends on nothing but the scene. */
    uint32_t (*apply)(struct import_result *import);
    int bits;     /* the picture keeps its bits */
    int moves;    /* of the scene with its animations, while the shutter is open */
    float factor; /* 0: none; the picture is so many times as bright */
    int part;     /* a row that does several has it, too: it runs where rows are asked for one by one */
};

extern const struct transform_row transforms[];
extern const size_t transform_count;

/* ---- helpers ---------------------------------------------------------------------------------- */

/* The bytes of a mesh (struct scene_mesh's layout). */
const uint8_t *transform_blob(const struct import_result *import, const struct scene_mesh *mesh);

/* Append a mesh: `mesh` with its counts, arrays and flags set, the name may be another's. Takes `blob` over
 * (mem_alloc'd, scene_mesh_layout()'s bytes, the last 16 of them 0) and sets mesh->blob and the bounds.
 * Returns its number. Pointers to scene.meshes are no longer valid. */
uint32_t transform_add_mesh(struct import_result *import, struct scene_mesh mesh, uint8_t *blob);

/* Append an instance. Pointers to scene.instances are no longer valid. */
void transform_add_instance(struct import_result *import, struct scene_instance instance);

/* Append a light. Pointers to scene.lights are no longer valid. */
void transform_add_light(struct import_result *import, struct scene_light light);

/* Append a material; returns its number. Pointers to scene.materials are no longer valid. */
uint32_t transform_add_material(struct import_result *import, struct scene_material material);

/* Does nothing move in the scene? */
int transform_all_stands(const struct scene *scene);

/* ---- transform.c: several at once ------------------------------------------------------------------- */

uint32_t transform_in_other_words(struct import_result *import);
uint32_t transform_elsewhere(struct import_result *import);

/* ---- transform_far.c: a card a thousand and ten million times the scene's size away, at one side -- */

uint32_t transform_far_thing(struct import_result *import);
uint32_t transform_very_far_thing(struct import_result *import);

/* ---- transform_faces.c: some faces, and all of many, written twice ------------------------------ */

uint32_t transform_copy_faces(struct import_result *import);
uint32_t transform_near_faces(struct import_result *import);

/* ---- transform_units.c: the same in other words --------------------------------------------------- */

#define TRANSFORM_LIGHT 4.0f

/* All lengths 1024 times as large. */
uint32_t transform_scale(struct import_result *import);
/* All that shines TRANSFORM_LIGHT times as bright. */
uint32_t transform_light(struct import_result *import);
/* One light more that gives none. */
uint32_t transform_black_light(struct import_result *import);
/* Instances whose mesh and matrix are mirrored. */
uint32_t transform_mirror(struct import_result *import);

/* ---- transform_place.c: another place, and what is not seen -------------------------------------- */

/* The axes exchanged. */
uint32_t transform_turn(struct import_result *import);
/* Triangles and portals that begin with another corner. */
uint32_t transform_corners(struct import_result *import);
/* An interface between nothing and nothing around everything. */
uint32_t transform_empty_box(struct import_result *import);
/* All indices of refraction twice as large, films half as thick, everything in something of index 2. Only for rooms that are
 * closed: what is beyond that is seen otherwise. Not a row. */
uint32_t transform_denser(struct import_result *import);

/* ---- transform_twice.c: two that make one ---------------------------------------------------------- */

/* Two lamps of half the light in the place of each. */
uint32_t transform_halve_lamps(struct import_result *import);
/* Each opaque surface a mix of itself and itself: the same bits. */
uint32_t transform_mix_with_itself(struct import_result *import);

/* ---- transform_cut.c: pieces ------------------------------------------------------------------------- */

/* Each triangle as four: faces, lamps, boundaries. */
uint32_t transform_quarter_faces(struct import_result *import);
/* Each closed body that light passes, glass or a medium, as two that touch. */
uint32_t transform_halve_bodies(struct import_result *import);

/* ---- transform_lists.c: another order, and more than is needed --------------------------------------- */

/* Meshes, images, textures, media, skins, and the materials of what is not refractive. */
uint32_t transform_reorder_tables(struct import_result *import);
/* The materials of what is. */
uint32_t transform_reorder_bodies(struct import_result *import);
/* Lights, portals and instances. */
uint32_t transform_reorder_lamps(struct import_result *import);
/* Nodes, and with them their channels. */
uint32_t transform_reorder_nodes(struct import_result *import);
/* Keys between keys, after the last, and of what stands. */
uint32_t transform_more_keys(struct import_result *import);
