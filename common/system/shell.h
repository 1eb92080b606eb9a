/* shell: words of a command line that a person may paste. */
#pragma once

#include "common/base/buffer.h"

/* Append a space and the word, quoted for a POSIX shell where that is needed. */
void shell_word(struct buffer *out, const char *word);
/* " --NAME WORD" */
void shell_option(struct buffer *out, const char *name, const char *word);
