#include "coordinator/net/admission.h"

#include <assert.h>
#include <string.h>

#include "common/base/memory.h"

/* ---- lines ---------------------------------------------------------------------------------- */

static void line_append(struct admission *a, struct admission_line *line, struct admission_place *place)
{
    place->number = ++a->numbers;
    place->next = NULL;
    place->previous = line->last;
    *(line->last ? &line->last->next : &line->first) = place;
    line->last = place;
}

static void line_remove(struct admission_line *line, struct admission_place *place)
{
    *(place->previous ? &place->previous->next : &line->first) = place->next;
    *(place->next ? &place->next->previous : &line->last) = place->previous;
    place->next = place->previous = NULL;
}

/* ---- addresses ------------------------------------------------------------------------------ */

static void turn_append(struct admission *a, struct admission_address *address)
{
    address->next = NULL;
    address->previous = a->last;
    *(a->last ? &a->last->next : &a->first) = address;
    a->last = address;
}

static void turn_remove(struct admission *a, struct admission_address *address)
{
    *(address->previous ? &address->previous->next : &a->first) = address->next;
    *(address->next ? &address->next->previous : &a->last) = address->previous;
}

/* The whole of an IPv4 address (::ffff:a.b.c.d), the network (64 bits) of an IPv6 address. */
static void address_key(uint8_t key[ADMISSION_ADDRESS_BYTES], const uint8_t bytes[ADMISSION_ADDRESS_BYTES])
{
    static const uint8_t mapped[12] = {[10] = 0xff, [11] = 0xff};

    memcpy(key, bytes, ADMISSION_ADDRESS_BYTES);
    if (memcmp(bytes, mapped, sizeof mapped) != 0)
        memset(key + 8, 0, ADMISSION_ADDRESS_BYTES - 8);
}

/* FNV-1a. An attacker can choose colliding addresses, but at most places_max of them. */
static struct admission_address **bucket_of(struct admission *a, const uint8_t *key)
{
    uint32_t hash = 2166136261u;

    for (int i = 0; i < ADMISSION_ADDRESS_BYTES; i++)
        hash = (hash ^ key[i]) * 16777619u;
    return &a->buckets[hash % ADMISSION_BUCKETS];
}

static struct admission_address *address_get(struct admission *a, const uint8_t *bytes)
{
    uint8_t key[ADMISSION_ADDRESS_BYTES];
    struct admission_address **bucket, *address;

    address_key(key, bytes);
    bucket = bucket_of(a, key);
    for (address = *bucket; address; address = address->same_bucket)
        if (memcmp(address->bytes, key, sizeof key) == 0)
            return address;
    address = mem_calloc(1, sizeof *address);
    if (!address)
        return NULL;
    memcpy(address->bytes, key, sizeof key);
    address->same_bucket = *bucket;
    *bucket = address;
    turn_append(a, address);
    return address;
}

static void address_drop(struct admission *a, struct admission_address *address)
{
    struct admission_address **at = bucket_of(a, address->bytes);

    while (*at != address)
        at = &(*at)->same_bucket;
    *at = address->same_bucket;
    turn_remove(a, address);
    mem_free(address);
}

/* ---- who must go ---------------------------------------------------------------------------- */

static int is_older(const struct admission_place *place, const struct admission_place *other)
{
    return place && (!other || place->number < other->number);
}

/* All places are taken, the newcomer's among them; see the header. */
static struct admission_place *choose(const struct admission *a, struct admission_place *newcomer)
{
    const struct admission_address *largest = a->first;
    struct admission_place *oldest = NULL;

    assert(largest); /* the newcomer's address, unless another is found */
    for (const struct admission_address *at = a->first; at; at = at->next) {
        struct admission_place *idle = at->idle.first;
        if (at->places > largest->places || (at->places == largest->places && is_older(idle, largest->idle.first)))
            largest = at;
        if (idle != newcomer && is_older(idle, oldest))
            oldest = idle;
    }
    if (newcomer->address->places == largest->places)
        largest = newcomer->address;
    if (largest->idle.first && largest->idle.first != newcomer)
        return largest->idle.first;
    if (largest->places > a->places_max / 2 && largest == newcomer->address)
        return newcomer;
    if (largest->places > a->places_max / 2 && largest->ready.last)
        return largest->ready.last;
    return oldest ? oldest : newcomer;
}

/* ---- stages --------------------------------------------------------------------------------- */

void admission_init(struct admission *a, uint32_t places_max)
{
    assert(places_max > 0);
    memset(a, 0, sizeof *a);
    a->places_max = places_max;
}

/* Remove the place from the queue and the count of its stage. */
static void stage_end(struct admission *a, struct admission_place *place)
{
    switch (place->stage) {
    case ADMISSION_SILENT:
    case ADMISSION_LEAVING: line_remove(&place->address->idle, place); break;
    case ADMISSION_READY:
        line_remove(&place->address->ready, place);
        a->ready--;
        break;
    case ADMISSION_SHAKING:
        place->address->shaking--;
        a->shaking--;
        break;
    case ADMISSION_OUTSIDE: break;
    }
}

status admission_enter(struct admission *a, struct admission_place *place,
                       const uint8_t address[ADMISSION_ADDRESS_BYTES], struct admission_place **out, struct error *err)
{
    *out = NULL;
    assert(place->stage == ADMISSION_OUTSIDE);
    place->address = address_get(a, address);
    NEED(place->address, err, "a connection's address");
    place->stage = ADMISSION_SILENT;
    place->address->places++;
    line_append(a, &place->address->idle, place);
    if (++a->places > a->places_max) {
        *out = choose(a, place);
        admission_leave(a, *out);
    }
    return STATUS_OK;
}

void admission_ready(struct admission *a, struct admission_place *place)
{
    if (place->stage != ADMISSION_SILENT)
        return;
    stage_end(a, place);
    place->stage = ADMISSION_READY;
    a->ready++;
    line_append(a, &place->address->ready, place);
}

struct admission_place *admission_next(struct admission *a)
{
    struct admission_address *address;
    struct admission_place *place;

    if (a->ready == 0 || a->shaking >= ADMISSION_HANDSHAKES_MAX)
        return NULL;
    for (address = a->first; address; address = address->next)
        if (address->ready.first && address->shaking < ADMISSION_ADDRESS_HANDSHAKES_MAX)
            break;
    if (!address)
        return NULL;
    place = address->ready.first;
    stage_end(a, place);
    place->stage = ADMISSION_SHAKING;
    address->shaking++;
    a->shaking++;
    turn_remove(a, address);
    turn_append(a, address);
    return place;
}

void admission_refused(struct admission *a, struct admission_place *place)
{
    if (place->stage != ADMISSION_SHAKING)
        return;
    stage_end(a, place);
    place->stage = ADMISSION_LEAVING;
    line_append(a, &place->address->idle, place);
}

void admission_leave(struct admission *a, struct admission_place *place)
{
    struct admission_address *address = place->address;

    if (place->stage == ADMISSION_OUTSIDE)
        return;
    stage_end(a, place);
    place->stage = ADMISSION_OUTSIDE;
    place->address = NULL;
    a->places--;
    if (--address->places == 0)
        address_drop(a, address);
}
