#include "coordinator/net/base/holders.h"

#include <inttypes.h>

#include "common/base/memory.h"
#include "common/schema/token_ceilings.h"
#include "common/system/clock.h"
#include "coordinator/store/files/blobs.h"

struct held_blob {
    struct digest digest;
    uint64_t bytes, begun_ns;
    int is_stored;
};

struct holder {
    struct holder *next;
    uint64_t number, bytes, looked_ns;
    uint32_t previews;
    struct held_blob *blobs;
    size_t count, capacity;
};

static const char *means(uint64_t number) { return number & HOLDER_KEY ? "key" : "token"; }

/* FNV-1a. Two names of one hash share a ceiling. */
uint64_t holder_of_key(const char *name)
{
    uint64_t hash = UINT64_C(14695981039346656037);

    if (!name[0])
        return 0;
    for (; *name; name++)
        hash = (hash ^ (uint8_t)*name) * UINT64_C(1099511628211);
    return hash | HOLDER_KEY;
}

static struct holder *find(const struct holders *holders, uint64_t number)
{
    struct holder *h = holders->first;

    while (h && h->number != number)
        h = h->next;
    return h;
}

static void forget(struct holder *h, size_t at)
{
    h->bytes -= h->blobs[at].bytes;
    h->blobs[at] = h->blobs[--h->count];
}

/* One that holds nothing makes place. */
static struct holder *take(struct holders *holders, uint64_t number)
{
    struct holder *h = find(holders, number), *unused = NULL;
    uint32_t count = 0;

    if (h)
        return h;
    for (h = holders->first; h; h = h->next, count++)
        if (h->count == 0 && h->previews == 0)
            unused = h;
    if (unused) {
        mem_free(unused->blobs);
        *unused = (struct holder){.next = unused->next, .number = number};
        return unused;
    }
    h = count < HOLDERS_MAX ? mem_calloc(1, sizeof *h) : NULL;
    if (h) {
        h->number = number;
        h->next = holders->first;
        holders->first = h;
    }
    return h;
}

/* What is gone from the store, and not on its way, counts no longer. */
static void look(struct holder *h, const char *folder, uint64_t now_ns)
{
    if (h->looked_ns && now_ns - h->looked_ns < HOLDER_LOOK_MS * NS_PER_MS)
        return;
    h->looked_ns = now_ns;
    for (size_t i = h->count; i-- > 0;) {
        uint64_t size;
        if ((h->blobs[i].is_stored || now_ns - h->blobs[i].begun_ns > HOLDER_UPLOAD_S * NS_PER_SECOND) &&
            blobs_find(folder, &h->blobs[i].digest, &size) == 0)
            forget(h, i);
    }
}

void holders_swept(struct holders *holders, const char *folder)
{
    for (struct holder *h = holders->first; h; h = h->next)
        for (size_t i = h->count; i-- > 0;) {
            uint64_t size;
            if (h->blobs[i].is_stored && blobs_find(folder, &h->blobs[i].digest, &size) == 0)
                forget(h, i);
        }
}

static uint64_t blob_ceiling(const struct holders *holders, enum web_role role)
{
    return holders->submit_blob_bytes && role <= WEB_ROLE_SUBMIT ? holders->submit_blob_bytes
                                                                 : token_ceiling_of(role).blob_bytes;
}

status holders_blob_begin(struct holders *holders, uint64_t number, enum web_role role, const char *folder,
                          const struct digest *digest, uint64_t bytes, uint64_t now_ns, struct error *err)
{
    uint64_t most = blob_ceiling(holders, role);
    struct holder *h;

    if (!number)
        return STATUS_OK;
    h = take(holders, number);
    NEED(h, err, "what a key or token holds");
    if (h->bytes + bytes > most || h->count >= HOLDER_BLOBS_MAX)
        look(h, folder, now_ns);
    if (h->bytes + bytes > most || h->count >= HOLDER_BLOBS_MAX)
        return error_set(err, STATUS_ERR_LIMIT,
                         "this %s has sent %" PRIu64 " MiB that no job needs, and may send %" PRIu64
                         " MiB: submit their job, or ask the operator to run 'azulejo gc --now'",
                         means(number), h->bytes >> 20, most >> 20);
    NEED(MEM_GROW(h->blobs, h->capacity, h->count + 1), err, "what a key or token holds");
    h->blobs[h->count++] = (struct held_blob){*digest, bytes, now_ns, 0};
    h->bytes += bytes;
    return STATUS_OK;
}

void holders_blob_stored(struct holders *holders, uint64_t number, const struct digest *digest)
{
    struct holder *h = number ? find(holders, number) : NULL;

    for (size_t i = 0; h && i < h->count; i++)
        if (digest_equal(&h->blobs[i].digest, digest))
            h->blobs[i].is_stored = 1;
}

void holders_blobs_used(struct holders *holders, uint64_t number, const struct digest *digests, size_t count)
{
    struct holder *h = number ? find(holders, number) : NULL;

    for (size_t i = h ? h->count : 0; i-- > 0;)
        for (size_t k = 0; k < count; k++)
            if (digest_equal(&h->blobs[i].digest, &digests[k])) {
                forget(h, i);
                break;
            }
}

status holders_preview_begin(struct holders *holders, uint64_t number, enum web_role role, struct error *err)
{
    uint32_t most = token_ceiling_of(role).previews;
    struct holder *h;

    if (!number)
        return STATUS_OK;
    h = take(holders, number);
    NEED(h, err, "what a key or token holds");
    if (h->previews >= most)
        return error_set(err, STATUS_ERR_LIMIT, "%u pictures are being made for this %s, as many as its role may have; "
                         "try again in a second", h->previews, means(number));
    h->previews++;
    return STATUS_OK;
}

void holders_preview_end(struct holders *holders, uint64_t number)
{
    struct holder *h = number ? find(holders, number) : NULL;

    if (h && h->previews > 0)
        h->previews--;
}

void holders_release(struct holders *holders)
{
    while (holders->first) {
        struct holder *h = holders->first;
        holders->first = h->next;
        mem_free(h->blobs);
        mem_free(h);
    }
}
