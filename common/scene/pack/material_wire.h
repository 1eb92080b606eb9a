/* material_wire: converts a material to and from message Material of scene.proto, by the rows of
 * material_fields.h. protobuf-c's descriptors give the position of a row's field in its struct;
 * tests/unit/scene/test_material.c checks that each row finds its field. */
#pragma once

#include <stddef.h>

#include "common/scene/material.h"
#include "common/scene/scene.pb-c.h"

/* Large enough for the structs of any group: more than twice that of the largest, Clearcoat. */
enum { MATERIAL_GROUP_BYTES = 256 };

struct material_wire {
    Azulejo__Scene__Material material;
    struct {
        _Alignas(max_align_t) unsigned char bytes[MATERIAL_GROUP_BYTES];
    } group[MATERIAL_MESSAGE_COUNT];
    Azulejo__Scene__TextureSlot slots[MATERIAL_TEXTURES];
};

/* wire->material becomes `m`; it points into `m` and `wire`. */
void material_wire_fill(struct material_wire *wire, const struct scene_material *m);
