/* Rows that wait for the writer thread, in a list. */
#include "common/base/memory.h"
#include "coordinator/store/store_parts.h"

static void noted_free(struct noted *first)
{
    while (first) {
        struct noted *next = first->next;
        mem_free(first);
        first = next;
    }
}

void noted_add(struct noted_list *list, void *row, size_t most)
{
    struct noted *last = row, *oldest = list->first;

    last->next = NULL;
    if (list->count == most) {
        list->first = oldest->next;
        list->count--;
        mem_free(oldest);
    }
    if (!list->first)
        list->end = &list->first;
    *list->end = last;
    list->end = &last->next;
    list->count++;
}

void noted_take(struct noted_list *list)
{
    list->taken = list->first;
    list->first = NULL;
    list->count = 0;
}

void noted_settle(struct noted_list *list, int written)
{
    struct noted *first = list->taken, *last = first;

    list->taken = NULL;
    if (!first || written) {
        noted_free(first);
        return;
    }
    for (list->count++; last->next; last = last->next)
        list->count++;
    last->next = list->first; /* newer ones may have come */
    if (!list->first)
        list->end = &last->next;
    list->first = first;
}

void noted_drop(struct noted_list *list)
{
    noted_free(list->first);
    list->first = NULL;
    list->count = 0;
}
