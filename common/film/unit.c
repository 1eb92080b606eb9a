#include "common/film/unit.h"

#include <math.h>
#include <string.h>

void unit_work_add(struct unit_work *sum, const struct unit_work *more)
{
    for (int i = 0; i < WORK_COUNTER_COUNT; i++)
        sum->count[i] += more->count[i];
    health_add(&sum->health, &more->health);
    sum->clamped_luminance += more->clamped_luminance;
    sum->kept_luminance += more->kept_luminance;
    depth_light_add(&sum->depth, &more->depth);
}

void unit_work_subtract(struct unit_work *sum, const struct unit_work *less)
{
    for (int i = 0; i < WORK_COUNTER_COUNT; i++)
        sum->count[i] -= less->count[i];
    health_subtract(&sum->health, &less->health);
    sum->clamped_luminance -= less->clamped_luminance;
    sum->kept_luminance -= less->kept_luminance;
    depth_light_subtract(&sum->depth, &less->depth);
}

double unit_work_clamped_share(const struct unit_work *work)
{
    double all = work->clamped_luminance + work->kept_luminance;

    return all > 0 ? work->clamped_luminance / all : 0;
}

/* ---- the largest contributions -------------------------------------------------------------- */

static int entry_before(const struct tail_entry *a, float value, uint32_t pixel)
{
    return a->value > value || (a->value == value && a->pixel <= pixel);
}

void tail_insert(struct tail *tail, float value, uint32_t pixel)
{
    uint32_t at = tail->count < TAIL_MAX ? tail->count++ : TAIL_MAX - 1;

    while (at > 0 && !entry_before(&tail->entries[at - 1], value, pixel)) {
        tail->entries[at] = tail->entries[at - 1];
        at--;
    }
    tail->entries[at] = (struct tail_entry){.value = value, .pixel = (uint16_t)pixel};
}

void tail_merge(struct tail *tail, const struct tail *more)
{
    struct tail merged = {.count = 0};
    uint32_t i = 0, j = 0;

    while (merged.count < TAIL_MAX && (i < tail->count || j < more->count)) {
        const struct tail_entry *a = &tail->entries[i], *b = &more->entries[j];
        int take_first = j == more->count || (i < tail->count && entry_before(a, b->value, b->pixel));
        merged.entries[merged.count++] = take_first ? *a : *b;
        *(take_first ? &i : &j) += 1;
    }
    *tail = merged;
}

int tail_is_valid(const struct tail *tail, uint32_t pixels)
{
    if (tail->count > TAIL_MAX)
        return 0;
    for (uint32_t i = 0; i < tail->count; i++) {
        const struct tail_entry *e = &tail->entries[i];
        if (!isfinite(e->value) || !(e->value > 0) || e->pixel >= pixels || e->spare != 0 ||
            (i > 0 && !entry_before(e - 1, e->value, e->pixel)))
            return 0;
    }
    return 1;
}

/* ---- hashing -------------------------------------------------------------------------------- */

static uint64_t hash_mix(uint64_t hash, uint64_t word)
{
    hash = (hash ^ word) * 0x9e3779b97f4a7c15ull;
    return hash ^ hash >> 32;
}

static uint64_t hash_words(uint64_t hash, const uint64_t *words, size_t count)
{
    for (size_t i = 0; i < count; i++)
        hash = hash_mix(hash, words[i]);
    return hash_mix(hash, hash >> 29);
}

static uint64_t double_bits(double value)
{
    uint64_t bits;

    memcpy(&bits, &value, sizeof bits);
    return bits;
}

uint64_t unit_hash(const struct unit_result *unit)
{
    const struct unit_work *w = &unit->work;
    const uint64_t rest[] = {double_bits(w->clamped_luminance), double_bits(w->kept_luminance), unit->tail.count};
    uint64_t hash = 0x243f6a8885a308d3ull ^ unit->count;

    for (size_t i = 0; i < unit->count; i++) {
        uint32_t bits;
        memcpy(&bits, &unit->sums[i], sizeof bits);
        hash = hash_mix(hash, bits);
    }
    for (uint32_t i = 0; i < unit->tail.count; i++) {
        uint32_t bits;
        memcpy(&bits, &unit->tail.entries[i].value, sizeof bits);
        hash = hash_mix(hash, (uint64_t)unit->tail.entries[i].pixel << 32 | bits);
    }
    hash = hash_words(hash, w->health.count, HEALTH_KINDS);
    hash = hash_words(hash, w->health.first, HEALTH_KINDS);
    for (int i = 0; i < DEPTH_SUMS; i++)
        hash = hash_mix(hash, double_bits(w->depth.sum[i]));
    for (int i = 0; i < WORK_COUNTERS_FIRST; i++)
        hash = hash_mix(hash, w->count[i]);
    return hash_words(hash, rest, sizeof rest / sizeof *rest);
}

uint64_t hash_bytes(const uint8_t *data, size_t size_bytes)
{
    uint64_t hash = 0x13198a2e03707344ull ^ size_bytes;

    for (; size_bytes >= 8; data += 8, size_bytes -= 8) {
        uint64_t word = 0;
        for (int i = 7; i >= 0; i--)
            word = word << 8 | data[i];
        hash = hash_mix(hash, word);
    }
    while (size_bytes--)
        hash = hash_mix(hash, *data++);
    return hash_mix(hash, hash >> 29);
}
