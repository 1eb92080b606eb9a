/* simplify: removes from a scene what no picture of it can show.
 *
 * It is an importer's last step before packing. A texture whose used channels are the same everywhere goes into its
 * factor, with the same product that the renderer would compute. Flat normal maps, and textures of layers whose weight
 * is 0, are dropped. Alpha that is 1 everywhere makes the material opaque. A uniform environment map becomes a colour.
 * Materials with a texture of roughness learn their least roughness.
 * Then images, textures and materials that nothing reaches any more are removed.
 *
 * On the way every image that a material can still show is decoded once, by all processors, and so is the environment
 * map: damaged files are found here.
 */
#pragma once

#include "common/scene/scene.h"

/* What was simplified; how many of each. */
struct scene_simplify_report {
    uint32_t folded;                      /* constant textures that became part of a factor */
    uint32_t flat_normals;                /* normal maps that say +z to 8 bits */
    uint32_t unseen;                      /* textures in slots that have no effect */
    uint32_t made_opaque;                 /* materials whose alpha mode had no effect */
    uint32_t mixes;                       /* mixes of which only one part ever appears */
    int uniform_environment;              /* the map was one colour */
    uint32_t materials, textures, images; /* removed */
    uint64_t image_bytes;                 /* of the removed images' files, and of the environment's */
    int image_failed;                     /* the error is an image's that cannot be decoded */
};

/* `scene` is valid before and after. ERR_NO_MEMORY, ERR_INPUT, ERR_LIMIT, ERR_UNSUPPORTED or the
 * reader's status: an image or a mesh cannot be read. The text names it, and the scene is still
 * valid but only partly simplified. Which blobs are needed afterwards: scene_blobs(). */
status scene_simplify(struct scene *scene, struct scene_blob_reader reader, struct scene_simplify_report *report,
                      struct error *err) MUST_CHECK;
