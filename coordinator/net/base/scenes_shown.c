#include "coordinator/net/base/scenes_shown.h"

#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/scene/scene.h"
#include "coordinator/job/queue.h"
#include "coordinator/store/files/blobs.h"

int scenes_were_shown(const struct scenes_shown *shown, const struct digest *scene)
{
    for (uint32_t i = 0; shown && i < shown->count; i++)
        if (digest_equal(&shown->scenes[i], scene))
            return 1;
    return 0;
}

void scenes_show(struct scenes_shown **shown, const struct digest *scene)
{
    struct scenes_shown *s = *shown ? *shown : (*shown = mem_calloc(1, sizeof **shown));

    if (!s || scenes_were_shown(s, scene))
        return;
    s->scenes[s->next] = *scene;
    s->next = (s->next + 1) % SCENES_SHOWN_MAX;
    if (s->count < SCENES_SHOWN_MAX)
        s->count++;
}

/* ---- what scenes need ------------------------------------------------------------------------- */

struct scene_list {
    struct digest scene;
    struct scene_blob *blobs; /* sorted */
    size_t count;
};

struct scene_lists {
    struct scene_list items[SCENE_LISTS_MAX];
    uint32_t count, next; /* the oldest one's place, once all are taken */
};

static int compare(const void *a, const void *b)
{
    return memcmp(&((const struct scene_blob *)a)->digest, &((const struct scene_blob *)b)->digest, sizeof(struct digest));
}

static status read_list(const char *folder, const struct digest *digest, struct scene_list *out, struct error *err)
{
    struct buffer packed = BUFFER_INIT;
    struct scene_blob *blobs = NULL;
    struct scene scene;
    size_t count = 0;
    status s = blobs_read(folder, digest, SCENE_BYTES_MAX, &packed, err);

    scene_init(&scene);
    THEN(s, scene_unpack(&scene, packed.data, packed.size, err));
    THEN(s, scene_blobs(&scene, &blobs, &count, err));
    if (s == STATUS_OK && count > 1)
        qsort(blobs, count, sizeof *blobs, compare);
    *out = (struct scene_list){.scene = *digest, .blobs = blobs, .count = count};
    scene_release(&scene);
    buffer_release(&packed);
    return s;
}

status scene_lists_has(struct scene_lists **lists, const char *folder, const struct digest *scene,
                       const struct digest *blob, int *has, uint64_t *size_bytes, struct error *err)
{
    struct scene_lists *all = *lists ? *lists : (*lists = mem_calloc(1, sizeof **lists));
    struct scene_list *list = NULL, made;
    const struct scene_blob key = {.digest = *blob}, *found;

    *size_bytes = 0;
    *has = digest_equal(scene, blob);
    if (*has)
        return STATUS_OK;
    NEED(all, err, "the blobs of scenes");
    for (uint32_t i = 0; !list && i < all->count; i++)
        if (digest_equal(&all->items[i].scene, scene))
            list = &all->items[i];
    if (!list) {
        TRY(read_list(folder, scene, &made, err));
        list = &all->items[all->next];
        mem_free(list->blobs);
        *list = made;
        all->next = (all->next + 1) % SCENE_LISTS_MAX;
        if (all->count < SCENE_LISTS_MAX)
            all->count++;
    }
    found = list->count > 0 ? bsearch(&key, list->blobs, list->count, sizeof key, compare) : NULL;
    *has = found != NULL;
    *size_bytes = found ? found->size_bytes : 0;
    return STATUS_OK;
}

void scene_lists_free(struct scene_lists *lists)
{
    for (uint32_t i = 0; lists && i < lists->count; i++)
        mem_free(lists->items[i].blobs);
    mem_free(lists);
}
