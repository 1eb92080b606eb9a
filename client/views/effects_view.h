/* effects_view: effects, and a finished frame's manifest, as people read them. */
#pragma once

#include <jansson.h>
#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"
#include "common/scene/scene_effects.h"

enum { CAUSE_TEXT_SIZE = 320, MANIFEST_BYTES_MAX = 1 << 20 };
/* The number of causes that are named; the JSON names more. */
enum { CAUSE_NAMES = 3 };

/* `material "wall", "floor", "lamp" and 2 more`; "-" without a kind. */
void cause_text(const struct effect_cause *cause, char out[CAUSE_TEXT_SIZE]);

/* Names behind a title, wrapped; a list without names prints nothing. */
struct name_list {
    const char *title;
    int column, count;
};
#define NAME_LIST_INIT(title) {title, 0, 0}
void name_list_add(struct name_list *list, const char *name);
void name_list_end(struct name_list *list);

/* A manifest as fetched. ERR_PROTOCOL: this release cannot read it. */
status manifest_parse(json_t **out, const uint8_t *data, size_t size_bytes, struct error *err) MUST_CHECK;
/* Print it to standard output. Fields that are missing are left out. */
void manifest_print(const json_t *manifest);
