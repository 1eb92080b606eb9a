/* A table by name: open addressing. */
#include <string.h>

#include "client/import/pbrt/read/pbrt_context.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"

static uint64_t hash_bytes(const void *data, size_t size)
{
    const uint8_t *bytes = data;
    uint64_t hash = 0xcbf29ce484222325u; /* FNV-1a */

    for (size_t i = 0; i < size; i++)
        hash = (hash ^ bytes[i]) * 0x100000001b3u;
    return hash ^ hash >> 29;
}

static struct pbrt_entry *table_slot(const struct pbrt_table *t, const void *key, size_t key_bytes)
{
    size_t at = (size_t)hash_bytes(key, key_bytes) & (t->size - 1);

    while (t->entries[at].key &&
           (t->entries[at].key_bytes != key_bytes || memcmp(t->entries[at].key, key, key_bytes) != 0))
        at = (at + 1) & (t->size - 1);
    return &t->entries[at];
}

void *pbrt_table_find(const struct pbrt_table *t, const void *key, size_t key_bytes)
{
    return t->size ? table_slot(t, key, key_bytes)->value : NULL;
}

void pbrt_table_set(struct pbrt_table *t, struct arena *arena, const void *key, size_t key_bytes, void *value)
{
    struct pbrt_entry *slot;

    if ((t->count + 1) * 2 > t->size) {
        struct pbrt_table grown = {.size = t->size ? t->size * 2 : 32, .count = t->count};
        grown.entries = must(mem_calloc(grown.size, sizeof *grown.entries));
        for (size_t i = 0; i < t->size; i++)
            if (t->entries[i].key)
                *table_slot(&grown, t->entries[i].key, t->entries[i].key_bytes) = t->entries[i];
        mem_free(t->entries);
        *t = grown;
    }
    slot = table_slot(t, key, key_bytes);
    if (!slot->key) {
        slot->key = must(arena_alloc(arena, key_bytes + 1, 1));
        memcpy(slot->key, key, key_bytes);
        slot->key_bytes = key_bytes;
        t->count++;
    }
    slot->value = value;
}

void pbrt_name_set(struct pbrt *p, struct pbrt_table *t, const char *name, const void *value)
{
    pbrt_table_set(t, &p->arena, name, strlen(name), (void *)value);
}

void pbrt_name_set_here(struct pbrt *p, struct pbrt_table *t, const char *name, const void *value)
{
    if (p->version3 && p->stack_count > 0) {
        MUST_GROW(p->renamed, p->renamed_capacity, p->renamed_count + 1);
        p->renamed[p->renamed_count++] =
            (struct pbrt_renamed){t, must(arena_strdup(&p->arena, name)), pbrt_name_find(t, name)};
    }
    pbrt_name_set(p, t, name, value);
}

void pbrt_names_restore(struct pbrt *p, size_t count)
{
    while (p->renamed_count > count) {
        const struct pbrt_renamed *r = &p->renamed[--p->renamed_count];
        pbrt_name_set(p, r->table, r->name, r->former);
    }
}

void *pbrt_name_find(const struct pbrt_table *t, const char *name) { return pbrt_table_find(t, name, strlen(name)); }
