/* scene_unpack_parts: the internals of scene_unpack, shared by its files; only they include this.
 *
 * scene_unpack.c           the walk along the top-level fields, and every limit on them
 * scene_unpack_values.c    the parts of elements: names, numbers, indices, blobs
 * scene_unpack_material.c  materials and their layers
 * scene_unpack_elements.c  every other element
 */
#pragma once

#include <google/protobuf-c/protobuf-c.h>

#include "common/scene/scene.h"
#include "common/scene/scene.pb-c.h"

struct scene_reader {
    const uint8_t *at, *end;
    struct scene *scene;
    struct error *err;
    int no_memory; /* set by the allocator */
    ProtobufCAllocator allocator;
};

static inline status unpack_damaged(const struct scene_reader *r, const char *what)
{
    return error_set(r->err, STATUS_ERR_INPUT, "the packed scene is damaged: %s", what);
}

/* From the wire's index + 1; scene_validate checks it against the table. */
status unpack_index(struct scene_reader *r, const char *what, uint32_t from, uint32_t maximum, int32_t *to) MUST_CHECK;
/* A copy of a string in the scene's arena; protobuf-c has already cut it at a NUL byte. */
status unpack_name(struct scene_reader *r, const char *text, const char **out) MUST_CHECK;
status unpack_floats(struct scene_reader *r, const char *what, const float *from, size_t got, float *to,
                     size_t wanted) MUST_CHECK;
/* As unpack_floats, but an absent field keeps its default. */
status unpack_floats_if(struct scene_reader *r, const char *what, const float *from, size_t got, float *to,
                        size_t wanted) MUST_CHECK;
status unpack_doubles(struct scene_reader *r, const char *what, const double *from, size_t got, double *to,
                      size_t wanted) MUST_CHECK;
/* A copy in the scene's arena; `got` may be 0. */
status unpack_array(struct scene_reader *r, const void *from, size_t got, size_t size_bytes, void **to) MUST_CHECK;
status unpack_blob(struct scene_reader *r, const Azulejo__Scene__Blob *from, struct scene_blob *to) MUST_CHECK;
status unpack_image(struct scene_reader *r, const Azulejo__Scene__Image *from, struct scene_image *to) MUST_CHECK;
status unpack_slot(struct scene_reader *r, const Azulejo__Scene__TextureSlot *from,
                   struct scene_texture_slot *to) MUST_CHECK;

#define TAKE(call)                     \
    do {                               \
        status result_ = (call);       \
        if (result_ != STATUS_OK)      \
            return result_;            \
    } while (0)
#define TAKE_FLOATS(field, to, wanted) \
    TAKE(unpack_floats(r, #field, m->field, m->n_##field, to, wanted))
#define TAKE_FLOATS_IF(field, to, wanted) \
    TAKE(unpack_floats_if(r, #field, m->field, m->n_##field, to, wanted))
#define TAKE_DOUBLES(field, to, wanted) \
    TAKE(unpack_doubles(r, #field, m->field, m->n_##field, to, wanted))
#define TAKE_DOUBLES_IF(field, to, wanted) \
    if (m->n_##field)                      \
        TAKE_DOUBLES(field, to, wanted)
#define KNOWN_FIELDS(what)            \
    if (m->base.n_unknown_fields)     \
        return unpack_damaged(r, what " has an unknown field");

/* One element: its decoded message into its row of the scene's table. */
typedef status unpack_element(struct scene_reader *r, const ProtobufCMessage *message, uint32_t row);
unpack_element unpack_mesh, unpack_image_row, unpack_texture, unpack_material, unpack_instance;
unpack_element unpack_light, unpack_camera, unpack_environment, unpack_node, unpack_channel, unpack_track;
unpack_element unpack_skin, unpack_medium, unpack_portal, unpack_origin;
