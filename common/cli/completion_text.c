#include <string.h>

#include "common/cli/completion.h"

enum { HELP_MAX = 64 };

void completion_put_function(const struct completion *c, struct buffer *out)
{
    for (const char *at = c->program; *at; at++)
        buffer_printf(out, "%c", *at == '-' ? '_' : *at);
}

void completion_put_help(struct buffer *out, const char *text, const char *special)
{
    size_t length = strcspn(text, "\n");

    if (length > HELP_MAX) {
        length = HELP_MAX;
        while (length > 0 && text[length] != ' ')
            length--;
    }
    for (size_t i = 0; i < length; i++)
        buffer_printf(out, strchr(special, text[i]) ? "\\%c" : "%c", text[i]);
    if (text[length] && text[length] != '\n')
        buffer_puts(out, " ...");
}
