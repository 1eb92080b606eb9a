#include "worker/key_file.h"

#include <openssl/crypto.h>
#include <string.h>

#include "common/system/log.h"

static struct stat look_at(const char *path)
{
    struct stat seen;

    if (stat(path, &seen) != 0)
        memset(&seen, 0, sizeof seen);
    return seen;
}

static int same_time(struct timespec a, struct timespec b) { return a.tv_sec == b.tv_sec && a.tv_nsec == b.tv_nsec; }

static int same_file(const struct stat *a, const struct stat *b)
{
    return a->st_dev == b->st_dev && a->st_ino == b->st_ino && a->st_size == b->st_size &&
           same_time(a->st_mtim, b->st_mtim) && same_time(a->st_ctim, b->st_ctim);
}

static status load_worker_key(struct farm_key *key, const char *path, struct error *err)
{
    uint8_t secret[FARM_KEY_BYTES];
    status s;

    TRY(farm_key_load(key, path, err));
    s = farm_key_for_role(key, FARM_ROLE_WORKER, secret, err);
    OPENSSL_cleanse(secret, sizeof secret);
    if (s != STATUS_OK)
        error_prefix(err, "%s", path);
    return s;
}

status key_file_load(struct key_file *file, const char *path, struct error *err)
{
    file->path = path;
    /* Before reading: a change in between is then seen as a change later. */
    file->seen = look_at(path);
    return load_worker_key(&file->key, path, err);
}

int key_file_refresh(struct key_file *file)
{
    struct stat now = look_at(file->path);
    struct farm_key key;
    struct error err = {0};
    int changed = 0;

    if (same_file(&now, &file->seen))
        return 0;
    file->seen = now;
    if (load_worker_key(&key, file->path, &err) != STATUS_OK)
        log_warn("%s; the key that was read before stays in use", err.text);
    else
        changed = memcmp(key.secret, file->key.secret, sizeof key.secret) != 0 || key.is_farm != file->key.is_farm;
    if (changed) {
        log_info("%s: the key was replaced; the new one is used from now on", file->path);
        file->key = key;
    }
    OPENSSL_cleanse(&key, sizeof key);
    return changed;
}
