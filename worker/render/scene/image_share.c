#include "worker/render/scene/image_share.h"

#include <stdatomic.h>
#include <string.h>

#include "common/base/memory.h"

enum { BUCKETS = 1024 };

struct image_share {
    struct digest digest;
    unsigned uses;
    struct texture_image *image;
    struct image_share *next, **previous; /* in its bucket */
    uint32_t references;                  /* under the lock */
};

/* Held only while one bucket is searched, never while an image is decoded. */
static atomic_flag lock = ATOMIC_FLAG_INIT;
static struct image_share *buckets[BUCKETS];

static void acquire(void)
{
    while (atomic_flag_test_and_set_explicit(&lock, memory_order_acquire))
        ;
}

static void release(void) { atomic_flag_clear_explicit(&lock, memory_order_release); }

static struct image_share **bucket_of(const struct digest *digest)
{
    return &buckets[(digest->bytes[0] | digest->bytes[1] << 8) % BUCKETS];
}

/* Under the lock. */
static struct image_share *find(const struct digest *digest, unsigned uses)
{
    struct image_share *share = *bucket_of(digest);

    while (share && !(share->uses == uses && digest_equal(&share->digest, digest)))
        share = share->next;
    return share;
}

static struct image_share *take(const struct digest *digest, unsigned uses)
{
    struct image_share *share;

    acquire();
    share = find(digest, uses);
    if (share)
        share->references++;
    release();
    return share;
}

static void share_free(struct image_share *share)
{
    if (share)
        texture_image_free(share->image);
    mem_free(share);
}

/* Insert it, unless another thread was faster: then use the other thread's. */
static struct image_share *publish(struct image_share *fresh)
{
    struct image_share **bucket = bucket_of(&fresh->digest), *share;

    acquire();
    share = find(&fresh->digest, fresh->uses);
    if (!share) {
        share = fresh;
        share->next = *bucket;
        share->previous = bucket;
        if (share->next)
            share->next->previous = &share->next;
        *bucket = share;
    }
    share->references++;
    release();
    if (share != fresh)
        share_free(fresh);
    return share;
}

status image_share_get(struct image_share **out, const struct digest *digest, unsigned uses, const uint8_t *data,
                       size_t size_bytes, const char *name, struct error *err)
{
    struct image_share *fresh;
    status s;

    *out = take(digest, uses);
    if (*out)
        return STATUS_OK;
    fresh = mem_calloc(1, sizeof *fresh);
    NEED(fresh, err, "a texture");
    fresh->digest = *digest;
    fresh->uses = uses;
    s = texture_image_new(&fresh->image, data, size_bytes, name, err);
    if (s == STATUS_OK && uses)
        s = texture_image_filter(fresh->image, uses, name, err);
    if (s != STATUS_OK) {
        share_free(fresh);
        return s;
    }
    *out = publish(fresh);
    return STATUS_OK;
}

void image_share_put(struct image_share *share)
{
    int last;

    if (!share)
        return;
    acquire();
    last = --share->references == 0;
    if (last) {
        *share->previous = share->next;
        if (share->next)
            share->next->previous = share->previous;
    }
    release();
    if (last)
        share_free(share);
}

struct texture_image *image_share_image(const struct image_share *share) { return share->image; }

int image_share_has(const struct digest *digest, unsigned uses)
{
    int has;

    acquire();
    has = find(digest, uses) != NULL;
    release();
    return has;
}
