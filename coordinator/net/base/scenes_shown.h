/* scenes_shown: which blobs a worker may read: those of the scenes that it was given work of.
 *
 * scenes_shown are a session's newest scenes, leases' and requests' alike; scene_lists, of a server, keep what scenes need,
 * which is read from their descriptions when it is asked for first. */
#pragma once

#include <stdint.h>

#include "common/base/digest.h"
#include "common/base/status.h"

enum { SCENES_SHOWN_MAX = 64, SCENE_LISTS_MAX = 64 };

/* Zeroed memory is an empty one. */
struct scenes_shown {
    struct digest scenes[SCENES_SHOWN_MAX];
    uint32_t count, next; /* the oldest one's place, once all are taken */
};
/* Add a scene; *shown is made when it is NULL. Without memory nothing is added: leases are looked at as well. */
void scenes_show(struct scenes_shown **shown, const struct digest *scene);
int scenes_were_shown(const struct scenes_shown *shown, const struct digest *scene);

struct scene_lists;
/* Is `blob` the scene or one of its blobs, and how many bytes does it have (0: not known)? `folder` is the store's. *lists is
 * made when it is NULL. ERR_NOT_FOUND: there is no such scene; ERR_IO, ERR_NO_MEMORY, and those of a damaged scene: not known. */
status scene_lists_has(struct scene_lists **lists, const char *folder, const struct digest *scene,
                       const struct digest *blob, int *has, uint64_t *size_bytes, struct error *err) MUST_CHECK;
void scene_lists_free(struct scene_lists *lists); /* NULL is fine */
