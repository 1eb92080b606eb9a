#include "protocol/worker_name.h"

#include <stdio.h>
#include <string.h>

static int is_word(const char *text, size_t length)
{
    static const char allowed[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-";

    /* Not an option, for who types it. */
    return length > 0 && length <= WORKER_NAME_BYTES_MAX && text[0] != '-' && strspn(text, allowed) >= length;
}

int worker_name_is_valid(const char *name) { return is_word(name, strlen(name)); }

int worker_label_is_valid(const char *label)
{
    size_t key = worker_label_key(label);

    return is_word(label, key) && (label[key] == 0 || worker_name_is_valid(label + key + 1));
}

void worker_label_make(char out[WORKER_LABEL_BYTES_MAX + 1], const char *key, const char *name)
{
    int alone = key[0] == 0 || strcmp(key, name) == 0;

    snprintf(out, WORKER_LABEL_BYTES_MAX + 1, "%s%s%s", alone ? "" : key, alone ? "" : "@", name);
}

size_t worker_label_key(const char *label) { return strcspn(label, "@"); }

int worker_labels_share_key(const char *a, const char *b)
{
    size_t key = worker_label_key(a);

    return key == worker_label_key(b) && memcmp(a, b, key) == 0;
}

int worker_label_is_of(const char *label, const char *name)
{
    return strcmp(label, name) == 0 || (!strchr(name, '@') && worker_labels_share_key(label, name));
}
