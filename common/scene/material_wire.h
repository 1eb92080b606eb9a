/* material_wire: a material as message Material of scene.proto, and back, by the rows of
 * material_fields.h. protobuf-c's descriptors say where a field with a row's number lies in its
 * struct; that each row finds its field is proved by tests/unit/scene/test_material.c. */
#ifndef AZULEJO_SCENE_MATERIAL_WIRE_H
#define AZULEJO_SCENE_MATERIAL_WIRE_H

#include <stddef.h>

#include "common/scene/material.h"
#include "common/scene/scene.pb-c.h"

/* Room for the structs of any group: more than twice that of the largest, Clearcoat. */
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

#endif
