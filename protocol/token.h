/* token: the text of a token of the page and its API: "azt_" and 256 random bits in hexadecimal. It is kept nowhere:
 * its SHA-256 tells whether a text is the token.
 */
#pragma once

#include "common/base/digest.h"
#include "common/base/status.h"

enum { TOKEN_TEXT_SIZE = 4 + 64 + 1 };

/* ERR_INTERNAL: there are no random numbers. */
status token_text_make(char out[TOKEN_TEXT_SIZE], struct error *err) MUST_CHECK;
int token_text_is(const char *text);
/* ERR_INTERNAL, ERR_NO_MEMORY. */
status token_text_hash(const char *text, struct digest *out, struct error *err) MUST_CHECK;
