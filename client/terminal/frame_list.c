#include "client/terminal/frame_list.h"

#include <stdlib.h>

#include "client/terminal/must.h"
#include "client/terminal/parse.h"
#include "common/base/memory.h"
#include "common/scene/settings.h"

void frame_list_free(struct frame_list *list)
{
    mem_free(list->items);
    *list = (struct frame_list){0};
}

/* Parse "7", "7-9" or "7-9x2"; returns its end. NULL: it is none of these. */
static const char *parse_item(const char *text, uint64_t *first, uint64_t *last, uint64_t *step)
{
    const char *at = parse_digits(text, INT32_MAX, first);

    *last = *first;
    *step = 1;
    if (!at || *at != '-')
        return at;
    at = parse_digits(at + 1, INT32_MAX, last);
    if (!at || *at != 'x')
        return at;
    return parse_digits(at + 1, INT32_MAX, step);
}

static int compare(const void *a, const void *b)
{
    uint32_t left = *(const uint32_t *)a, right = *(const uint32_t *)b;

    return (left > right) - (left < right);
}

static void sort_once(struct frame_list *list)
{
    size_t kept = 0;

    qsort(list->items, list->count, sizeof *list->items, compare);
    for (size_t i = 0; i < list->count; i++)
        if (kept == 0 || list->items[i] != list->items[kept - 1])
            list->items[kept++] = list->items[i];
    list->count = kept;
}

status frame_list_parse(const char *text, struct frame_list *out, struct error *err)
{
    uint64_t first = 0, last = 0, step = 0;
    size_t capacity = 0;

    *out = (struct frame_list){0};
    for (const char *at = text;; at++) {
        at = parse_item(at, &first, &last, &step);
        if (!at || (*at && *at != ',') || step == 0)
            return error_set(err, STATUS_ERR_USAGE,
                             "--frames: '%s' is not a list of frames: write numbers and ranges, with "
                             "a step if you like, as in 1,5,10-100x10",
                             text);
        if (last < first)
            return error_set(err, STATUS_ERR_USAGE, "--frames: %s: the first is after the last", text);
        if ((last - first) / step + out->count >= SETTINGS_FRAMES_MAX)
            return error_set(err, STATUS_ERR_USAGE, "--frames: %s: more than %d frames", text, SETTINGS_FRAMES_MAX);
        MUST_GROW(out->items, capacity, out->count + (last - first) / step + 1);
        for (; first <= last; first += step)
            out->items[out->count++] = (uint32_t)first;
        if (*at == 0)
            break;
    }
    sort_once(out);
    return STATUS_OK;
}

void frame_list_ends(struct frame_list *list)
{
    uint32_t *items = list->items;

    if (list->count <= 3)
        return;
    items[1] = items[(list->count - 1) / 2];
    items[2] = items[list->count - 1];
    list->count = 3;
}

/* The list is as if --frames had named every frame. */
static void all_ends(uint32_t first, uint32_t last, struct frame_list *out)
{
    out->items = must(mem_alloc_array(3, sizeof *out->items));
    out->items[out->count++] = first;
    if (last - first > 1)
        out->items[out->count++] = first + (last - first) / 2;
    if (last > first)
        out->items[out->count++] = last;
}

status frame_choice_check(const struct frame_choice *choice, struct error *err)
{
    struct frame_list list;
    status result = choice->list ? frame_list_parse(choice->list, &list, err) : STATUS_OK;

    if (choice->list)
        frame_list_free(&list);
    return result;
}

status frame_choice_of(const struct frame_choice *choice, uint32_t first, uint32_t last, struct frame_list *out,
                       struct error *err)
{
    *out = (struct frame_list){0};
    if (!choice->list) {
        if (choice->first_middle_last)
            all_ends(first, last, out);
        return STATUS_OK;
    }
    TRY(frame_list_parse(choice->list, out, err));
    for (size_t i = 0; i < out->count; i++)
        if (out->items[i] < first || out->items[i] > last)
            return error_set(err, STATUS_ERR_USAGE, "--frames: the job has frames %u to %u, not %u", first, last,
                             out->items[i]);
    if (choice->first_middle_last)
        frame_list_ends(out);
    return STATUS_OK;
}
