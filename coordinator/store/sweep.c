#include "coordinator/store/sweep.h"

#include <dirent.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/system/file.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "common/scene/scene.h"
#include "coordinator/job/queue.h"
#include "coordinator/store/files/blobs.h"
#include "coordinator/store/store_hold.h"

struct needed_blob {
    struct digest digest;
    uint64_t bytes;
};
/* The blobs that jobs need; sorted once they are complete. */
struct needed {
    struct needed_blob *items;
    size_t count, capacity;
};

static int compare(const void *a, const void *b)
{
    return memcmp(&((const struct needed_blob *)a)->digest, &((const struct needed_blob *)b)->digest, sizeof(struct digest));
}

static status add(struct needed *n, const struct digest *digest, uint64_t bytes, struct error *err)
{
    NEED(MEM_GROW(n->items, n->capacity, n->count + 1), err, "the blobs that jobs need");
    n->items[n->count++] = (struct needed_blob){*digest, bytes};
    return STATUS_OK;
}

/* The scene and its blobs; their bytes. A scene that is not there, or damaged, needs nothing: none of its
 * jobs can be rendered, and a client that sends it again sends its blobs, too. */
static status add_scene(struct needed *n, const char *folder, const struct digest *digest, uint64_t *bytes,
                        struct error *err)
{
    struct buffer packed = BUFFER_INIT;
    struct scene_blob *blobs = NULL;
    struct scene scene;
    size_t count = 0;
    status s = blobs_read(folder, digest, SCENE_BYTES_MAX, &packed, err);

    scene_init(&scene);
    *bytes = packed.size;
    THEN(s, scene_unpack(&scene, packed.data, packed.size, err));
    THEN(s, scene_blobs(&scene, &blobs, &count, err));
    THEN(s, add(n, digest, packed.size, err));
    for (size_t i = 0; i < count && s == STATUS_OK; i++) {
        s = add(n, &blobs[i].digest, blobs[i].size_bytes, err);
        *bytes += blobs[i].size_bytes;
    }
    if (s != STATUS_OK && !status_is_environment(s)) {
        log_debug("a scene whose blobs are not known: %s", err->text);
        s = add(n, digest, packed.size, err);
    }
    mem_free(blobs);
    scene_release(&scene);
    buffer_release(&packed);
    return s;
}

static int compare_scenes(const void *a, const void *b)
{
    return memcmp(&((const struct blob_user *)a)->scene, &((const struct blob_user *)b)->scene, sizeof(struct digest));
}

static status add_file(struct needed *n, const char *folder, const struct blob_user *user, struct error *err)
{
    uint64_t bytes = 0;

    if (!user->has_file)
        return STATUS_OK;
    (void)blobs_find(folder, &user->file, &bytes);
    return add(n, &user->file, bytes, err);
}

static status find_needed(struct blob_user *users, size_t count, const char *folder, struct needed *n, struct error *err)
{
    status s = STATUS_OK;

    if (count > 0)
        qsort(users, count, sizeof *users, compare_scenes);
    for (size_t i = 0, end; i < count && s == STATUS_OK; i = end) {
        uint64_t bytes = 0;
        for (end = i + 1; end < count && compare_scenes(&users[i], &users[end]) == 0;)
            end++;
        s = add_scene(n, folder, &users[i].scene, &bytes, err);
        for (size_t k = i; k < end && s == STATUS_OK; k++) {
            users[k].bytes = end - i == 1 ? bytes : 0;
            s = add_file(n, folder, &users[k], err);
        }
    }
    if (n->count > 0)
        qsort(n->items, n->count, sizeof *n->items, compare);
    return s;
}

static int is_needed(const struct needed *n, const struct digest *digest)
{
    const struct needed_blob key = {.digest = *digest};

    return n->count > 0 && bsearch(&key, n->items, n->count, sizeof key, compare) != NULL;
}

static void sweep_folder(struct sweep *sweep, const struct needed *n, const char *store, int blobs, const char *name)
{
    int fd = openat(blobs, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
    DIR *folder = fd >= 0 ? fdopendir(fd) : NULL;
    const struct dirent *entry;

    if (!folder && fd >= 0)
        close(fd);
    while (folder && (entry = readdir(folder))) {
        struct digest digest;
        uint64_t bytes = 0;
        if (digest_from_hex(&digest, entry->d_name) != STATUS_OK || is_needed(n, &digest))
            continue;
        if (blobs_remove_older(store, &digest, sweep->cutoff_ns, &bytes)) {
            sweep->removed++;
            sweep->removed_bytes += bytes;
        } else {
            sweep->waiting++;
            sweep->waiting_bytes += bytes;
        }
    }
    if (folder)
        closedir(folder);
}

static status sweep_blobs(struct sweep *sweep, const struct needed *n, const char *store, struct error *err)
{
    char *path = file_join(store, "blobs");
    DIR *blobs = path ? opendir(path) : NULL;
    const struct dirent *entry;

    NEED(path, err, "a path");
    mem_free(path);
    if (!blobs)
        return STATUS_OK;
    while ((entry = readdir(blobs)))
        if (strlen(entry->d_name) == 2 && entry->d_name[0] != '.')
            sweep_folder(sweep, n, store, dirfd(blobs), entry->d_name);
    closedir(blobs);
    return STATUS_OK;
}

status sweep_bytes(struct blob_user *users, size_t count, const char *folder, uint64_t *bytes, struct error *err)
{
    struct needed n = {0};
    status s = find_needed(users, count, folder, &n, err);

    *bytes = 0;
    for (size_t i = 0; i < n.count; i++)
        if (i == 0 || compare(&n.items[i - 1], &n.items[i]) != 0)
            *bytes += n.items[i].bytes;
    mem_free(n.items);
    return s;
}

status sweep_run(struct sweep *sweep, const char *folder, struct error *err)
{
    struct needed n = {0};
    int hold = -1;
    status s = store_hold_exclude(folder, &hold, err);

    THEN(s, find_needed(sweep->users, sweep->count, folder, &n, err));
    THEN(s, sweep_blobs(sweep, &n, folder, err));
    store_hold_end(hold);
    mem_free(n.items);
    if (s == STATUS_OK && sweep->removed > 0)
        log_info("%" PRIu64 " blobs that no job needs are removed: %" PRIu64 " KiB", sweep->removed,
                 sweep->removed_bytes / 1024);
    return s;
}
