#include "common/system/shell.h"

#include <string.h>

void shell_word(struct buffer *out, const char *word)
{
    static const char plain[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-./,:=@%+";

    buffer_puts(out, " ");
    if (*word && word[strspn(word, plain)] == 0) {
        buffer_puts(out, word);
        return;
    }
    buffer_puts(out, "'");
    for (; *word; word++)
        buffer_printf(out, *word == '\'' ? "'\\''" : "%c", *word);
    buffer_puts(out, "'");
}

void shell_option(struct buffer *out, const char *name, const char *word)
{
    buffer_printf(out, " --%s", name);
    shell_word(out, word);
}
