/* simplify: takes out of a scene what cannot be seen in any picture of it.
 *
 * An importer's last step before it packs: textures whose used channels are the same
 * everywhere go into their factors, with the very product that the renderer would have
 * computed; flat normal maps, and textures of layers whose weight is 0, are dropped; alpha
 * that is 1 everywhere makes the material opaque; a uniform environment map becomes a colour.
 * Then images, textures and materials that nothing reaches any more are removed.
 *
 * Every image that a material can still show is decoded once on the way, one at a time, and so
 * is the environment map: damaged files are found here.
 */
#ifndef AZULEJO_SCENE_SIMPLIFY_H
#define AZULEJO_SCENE_SIMPLIFY_H

#include "common/scene/scene.h"

/* Where a blob's bytes are found; they must stay valid until scene_simplify returns. */
struct scene_blob_reader {
    status (*get)(void *user, const struct digest *digest, const uint8_t **data,
                  size_t *size_bytes, struct error *err);
    void *user;
};

/* What was done; how many of each. */
struct scene_simplify_report {
    uint32_t folded;            /* constant textures that became part of a factor */
    uint32_t flat_normals;      /* normal maps that say +z to 8 bits */
    uint32_t unseen;            /* textures in slots that cannot act */
    uint32_t made_opaque;       /* materials whose alpha mode did nothing */
    uint32_t mixes;             /* mixes of which only one part is ever there */
    int uniform_environment;    /* the map was one colour */
    uint32_t materials, textures, images; /* removed */
    uint64_t image_bytes;       /* of the removed images' files, and of the environment's */
};

/* `scene` is valid before and after. ERR_NO_MEMORY, ERR_INPUT, ERR_LIMIT, ERR_UNSUPPORTED or what
 * the reader says: an image or a mesh cannot be read; its name is in the text, and the scene is
 * still valid, but only partly simplified. Which blobs are needed after it: scene_blobs(). */
status scene_simplify(struct scene *scene, struct scene_blob_reader reader,
                      struct scene_simplify_report *report, struct error *err) MUST_CHECK;

#endif
